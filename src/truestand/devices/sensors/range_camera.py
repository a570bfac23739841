"""Any GigE Vision camera that sends range as Mono16: a row of a frame is a profile, a column is a place along the line.

Rate, exposure and trigger are settings of the camera, made with its maker's tool and stored in it; the driver reads
only the size of a frame, and switches the stream.
"""

from truestand.core.errors import DeviceError
from truestand.core.stand import Sensor
from truestand.devices.gige.assembly import FRAME_END_TIMEOUT_S
from truestand.devices.gige.camera import Camera
from truestand.devices.sensor import Laser, Layout
from truestand.devices.sensors.recipe import SensorRecipe


class RangeCamera(Camera):
    """A range camera as ``LineSensor``. It has no counter, time or encoder in its frames, and switches no laser."""

    def __init__(self, recipe: SensorRecipe, sensor: Sensor) -> None:
        """Connects and takes control. Errors as ``open_sensor``."""
        self._recipe = recipe
        self._points, self._rate = recipe.shape(sensor)
        super().__init__(recipe.name, recipe.address, recipe.heartbeat_ms)

    def start(self) -> Layout:
        """Read the size of a frame, and stream.

        Raises:
            DeviceLost: no answer.
            DeviceError: no Mono16, another number of columns than the recipe's, or refused.
        """
        nodes = self.nodes
        nodes.set("PixelFormat", "Mono16")
        width, height = int(nodes.get("Width")), int(nodes.get("Height"))
        if width != self._points:
            raise DeviceError(
                f"{self.name}: found {width} columns, need the {self._points} points of stand.toml; set the camera's "
                "Width or the points"
            )
        assert self._recipe.x_step_mm is not None and self._recipe.z_step_mm is not None
        scale = (self._recipe.x_first_mm, self._recipe.x_step_mm, self._recipe.z_zero_mm, self._recipe.z_step_mm)
        model = str(nodes.get("DeviceModelName")) if nodes.has("DeviceModelName") else self._recipe.model
        layout = Layout("range-camera", model, width, height, self._rate, scale=scale)
        self.start_stream(
            layout.frame_bytes,
            2 * width,
            self._recipe.packet_size,
            self._recipe.packet_delay,
            self._recipe.resend,
            frame_end_timeout=max(FRAME_END_TIMEOUT_S, 3 * height / self._rate),
        )
        return layout

    def set_laser(self, power: Laser) -> None:
        """Nothing is switched: a person or the table's controller does that.

        Raises:
            DeviceError: off, where the recipe doesn't say that there is no laser; on, where it does.
        """
        if self._recipe.laser == "none":
            if power != "off":
                raise DeviceError(f'{self.name}: it has no laser to be switched on; stand.toml says laser = "none"')
        elif power == "off":
            raise DeviceError(
                "a range camera can't switch its laser: switch it off at its supply; where it has none, or one that is "
                'switched and locked without truestand, say laser = "none" in [[devices.sensor]]'
            )
