"""What it means: verdicts on parameters, previews of campaigns."""
