"""The verdict on a design: judged, recorded, priced, repaired, checked."""
