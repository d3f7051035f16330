# A program with a mistake
from pybricks.hubs import PrimeHub
from pybricks.parameters import Port
from pybricks.pupdevices import Motor

hub = PrimeHub()
motor = Motor(Port.A)

print("The hub says what is wrong, and the line is marked.")
motor.run_angel(500, 90)
