"""Controllers: each package has what is known of one controller, behind the protocol of protocol.py."""
