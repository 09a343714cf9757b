"""The browser page of ``ldbb-bayes app``: its server, and processes that answer its requests."""
