"""Tables as they are found: files of instruments and spreadsheets into a campaign."""
