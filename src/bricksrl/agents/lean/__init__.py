"""Networks learn here without autograd: gradients by hand, in memory that is kept, over parameters in one piece.

`bricksrl.agents.networks` says what the networks compute; this says how, in less time than a framework takes to keep its books.
"""
