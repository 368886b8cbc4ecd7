"""Pages and files of results: everything that a command writes is made here, from frozen results."""
