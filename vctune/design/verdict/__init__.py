"""The verdict on a design: its judgement, record, prices, repairs and check."""
