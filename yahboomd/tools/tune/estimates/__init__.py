"""Tuning of a board's speed loop, from counts alone: step responses, a model, dead zone and gains.

``step_response`` turns counts into the figures of a step; ``loop_model`` is the board's loop with a
motor behind it, fitted to steps; ``dead_zone`` finds the output at which wheels begin to turn;
``suggestion`` computes gains.
"""
