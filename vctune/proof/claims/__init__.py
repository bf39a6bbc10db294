"""What is proved of a design, claim by claim, for one or many designs and devices."""
