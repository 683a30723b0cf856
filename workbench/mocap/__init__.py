"""Motion files in, one motion library out."""
