"""Sessions to and from the files of other benches and programs."""
