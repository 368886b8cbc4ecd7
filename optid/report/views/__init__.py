"""One module per kind of result: `plot(result, axes)` and `page(result)`."""
