# Drive around
# Robot: two-wheeler
from pybricks.hubs import PrimeHub

hub = PrimeHub()
