"""`hapticd scope`: a live view in the browser, served by an unprivileged process of its own."""
