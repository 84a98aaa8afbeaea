"""The four stages, each pure and each written like the method section of a paper."""
