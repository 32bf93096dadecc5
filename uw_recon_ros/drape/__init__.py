"""What a surface looks like from above: height and colour by cells."""
