"""The example that ends every help text."""

from typing import Final

CHAIN: Final = """\b
Example, the whole chain:
  cmm-align offset     nominal.csv --tip-radius 1.5
  cmm-align align      part.csv nominal.h5
  cmm-align error-map  part.align.h5
  cmm-align compensate part.map.h5
"""
