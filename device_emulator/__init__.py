"""The board on the other end of the wire: plant, sense chain, drive chain and firmware of a gyro."""
