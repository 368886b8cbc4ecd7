"""Results as pages and files: everything a command leaves behind is made here, from frozen results."""
