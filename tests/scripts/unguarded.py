import sys
from math import sqrt

from ldbb_bayes.parallel import done, executor_named

with executor_named(sys.argv[1], 2) as executor:
    print(dict(done(sqrt, range(5), executor)))
