"""Real records, measured by others: traced, refined, scored on the part that was kept out."""
