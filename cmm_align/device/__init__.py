"""The controller port: captured without loss, recorded, and replayed.

The only importer of pySerial. `link` opens a line, `reader` writes every byte into a `journal` before
anything looks at it, `intake` makes points of what the reader hands on, and `capture` puts them together.
`replay` serves recordings in the place of a port, so that live and recorded runs share one path, with
`faults` for tests. `tap` listens to a client and a server that talk over TCP. Nothing is ever sent.

What a name means (`address`) and what a file is (`recordings`) is told without loading the rest.
"""
