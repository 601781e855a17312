"""``python -m benchmarks.identify``: does `hapticd identify` find hidden devices, and do its intervals hold the truth?"""
