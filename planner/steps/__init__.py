"""The steps of a planning run: columns are found, a bound proven, optimistic columns refuted, the settings settled.

Each step reads and fills the pools of one `planner.steps.run.Run`. Same request and seed, same bits, with or without
interruption.
"""
