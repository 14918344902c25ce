"""Native code: find a compiler, build, cache by content, load; what externs are bound to."""
