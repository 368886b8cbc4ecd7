"""One module a kind of result: `plot(result, axes)` and `page(result)`."""
