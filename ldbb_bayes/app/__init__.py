"""The browser page of ``ldbb-bayes app``: a server, and processes that compute its answers."""
