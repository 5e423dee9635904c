"""What the base model lacks: effects declared once, carried by observer, controller and angle alike."""
