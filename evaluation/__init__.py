"""What is measured of tracing: on emulated devices with an effect nobody declared, and on records of others."""
