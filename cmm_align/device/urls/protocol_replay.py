"""The door through which pySerial finds `replay://`."""

from cmm_align.device.replay import ReplayPort as Serial

__all__ = ["Serial"]
