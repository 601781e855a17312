"""A third-party driver: a shaft with viscous friction, simulated in Python, that moves by one period at every sample."""

from drivers import DriverError, PythonDriver, driver_options
from hapticd.config import Config


class ToyBoard(PythonDriver):
    """Option ``driver.start_counts``: where the shaft is when the board is opened (raw counts)."""

    summary = "toy board: a shaft simulated in Python"
    latency_s = 0.0  # declare here the time from sampling the encoder to the current in the motor, s

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        options = driver_options(config)
        self.start = options.pop("start_counts", 0)
        if options or not isinstance(self.start, int):
            raise DriverError("driver: toy_board takes one option, start_counts, a whole number of counts")
        self.position = self.velocity = self.current = 0.0

    def connect(self) -> None:
        """Open the port, read the identity, check it: here there is only a position to set. Ends at zero, disabled."""
        self.position = (self.start + 0.5) * self.config.raw_resolution  # in the middle of a count

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
