"""Hidden effects: what the board has and its data sheet does not declare, by name, from `[[effect]]` tables.

To add one, in the module of the place where it acts: its kind with a number of its own and its entry in `DECLARATIONS`;
then the same number and its lines in the header of that name in `device_emulator/native`. `force` is the mass and its
suspension, `drive` what reaches the mass of the converter's force, `sense` what the combs read, the amplifiers make of
it and the converter shows. Coefficients are SI and per unit mass.
"""
