"""What was measured, or is to be: circular tests, campaigns, plans, and the files they live in."""
