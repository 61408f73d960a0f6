"""The browser page: what of a scan is shown, its history, who plays it, and who serves it."""
