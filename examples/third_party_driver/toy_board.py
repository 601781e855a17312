"""A third-party driver: a shaft with viscous friction, simulated in Python, that moves by one period at every sample."""

from drivers import PythonDriver, read_options
from hapticd.config.fields import Section, Whole, quantity


class Options(Section):
    """What stands beside ``driver.name``, one line each: `hapticd check` refuses all else."""

    start_counts: Whole = quantity(0, "where the shaft is when the board is opened", "counts")


class ToyBoard(PythonDriver):
    """A PythonDriver has four methods."""

    summary = "toy board: a shaft simulated in Python"
    options = Options
    latency_s = 0.0  # declare here the time from sampling the encoder to the current in the motor, s

    def connect(self) -> None:
        """Open the port, read the identity, check it: here there is only a position to set. Ends at zero, disabled."""
        self.velocity = self.current = 0.0
        start = read_options(self.config, Options).start_counts
        self.position = (start + 0.5) * self.config.raw_resolution  # in the middle of a count

    def disconnect(self) -> None:
        """Leave the device at zero, disabled; also called twice, and after a failed connect."""
        self.current = 0.0

    def read_counts(self) -> int | None:
        """The counts now; None would be a missed sample, an exception a fault."""
        plant, motor, period = self.config.plant, self.config.amplifier, self.config.period
        force = motor.torque_constant * self.current - plant.viscous * self.velocity
        self.velocity += force / plant.inertia * period
        self.position += self.velocity * period
        return int(self.position // self.config.raw_resolution)

    def write_current(self, current: float, enable: bool) -> None:
        """Command a current in A; a real board must treat ``enable`` False as amplifier off."""
        self.current = current if enable else 0.0
