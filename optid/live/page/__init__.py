"""The page in the browser: one small server, one page, no files from elsewhere."""
