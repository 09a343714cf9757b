"""Exit code 0 where this processor can run the kernels of an OpenBLAS core type: `python
tests/cores.py SkylakeX`."""

from __future__ import annotations

import sys
from pathlib import Path

NEEDS = {
    "Nehalem": {"sse4_2"},
    "Haswell": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512dq", "avx512bw", "avx512vl"},
}

if __name__ == "__main__":
    information = Path("/proc/cpuinfo")
    flags = set(information.read_text(encoding="utf-8").split()) if information.exists() else set()
    sys.exit(not NEEDS[sys.argv[1]] <= flags)
