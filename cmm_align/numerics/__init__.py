"""Arrays in, arrays out: the mathematics, free of files, frames and settings."""
