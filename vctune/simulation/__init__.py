"""The paper's experiments in sampled-data time: a continuous device with friction under a discrete controller."""
