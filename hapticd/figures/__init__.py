"""One look for every figure and every page that hapticd writes."""
