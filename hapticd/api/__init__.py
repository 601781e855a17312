"""The functions of ``import hapticd``, one module per subject; `hapticd` itself exports all of them."""
