"""Which tests to run next: optimum design of campaigns."""
