"""URL handlers, found by pySerial through their names: `protocol_<scheme>`.

`replay://` is ours; `socket://` is pySerial's own with what is needed to lose nothing.
"""
