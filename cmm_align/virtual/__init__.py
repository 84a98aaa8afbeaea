"""Synthetic truth: a window, its form error, the CMM that measures it and the grinder that cuts it.

Everything here is pure and seeded: the same seed gives the same bytes. The demo, the sample data and
the tests draw from this room, so that every answer of the chain can be held against what is true.
It knows the surfaces and the poses, and none of the stages it is used to check.
"""
