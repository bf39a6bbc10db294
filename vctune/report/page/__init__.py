"""The page: its contents, tables, sliders and sentences."""
