"""What ``import hapticd`` offers, one module a subject; `hapticd` itself names all of it."""
