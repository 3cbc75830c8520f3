"""The engine: experiments, keys, store, plan, runner and command line. It knows nothing about robots."""
