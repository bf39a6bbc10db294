"""What a design is worth: judged, recorded, priced, repaired, checked."""
