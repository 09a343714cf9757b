"""The page in the browser: a server, and the worker that computes for it."""
