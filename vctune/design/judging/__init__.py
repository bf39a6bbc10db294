"""Judge given gains: error, margins, certificate, and what they say in words."""
