"""What a nominal is: one protocol, one file per kind; geometry derived once for all of them."""
