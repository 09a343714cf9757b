"""The browser page of ``ldbb-bayes app``: its server, and processes that compute its answers."""
