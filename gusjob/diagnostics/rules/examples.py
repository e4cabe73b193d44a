"""Beginnings of jobs that the examples of several families share."""

HEAD = "LASER MODE DUTY CARRIER 10kHz\nVEL 100\nACC 10000\n"
LASER_ON = HEAD + "LASER POWER 30\nLASER ON\n"
