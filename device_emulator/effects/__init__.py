"""Hidden effects: what the board has and its data sheet does not declare, by name, from `[[effect]]` tables.

To add one, in the module of the place where it acts: its entry in `DECLARATIONS`; then a case of its name in the header
of that name in `device_emulator/native`. `force` is the mass and its
suspension, `drive` what reaches the mass of the converter's force, `sense` what the combs read, the amplifiers make of
it and the converter shows. Coefficients are SI and per unit mass.
"""
