"""Networks used by systems and evaluation, such as encoders; may import what systems may."""
