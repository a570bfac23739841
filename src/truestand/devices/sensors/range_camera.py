"""Any GigE Vision camera that sends range as Mono16: a frame is rows of profiles, a column is a place along the line.

Rate, exposure and trigger are the camera's own settings, made with its maker's tool and kept in it; only the size of a
frame is read and the stream is switched.
"""

from truestand.core.errors import DeviceError
from truestand.core.stand import Sensor
from truestand.devices.gige.assembly import SILENCE
from truestand.devices.gige.camera import Camera
from truestand.devices.sensor import Frame, Laser, Layout, StreamStatistics
from truestand.devices.sensors.recipe import SensorRecipe


class RangeCamera:
    """A range camera as ``LineSensor``. It has no counter, time or encoder in its frames, and switches no laser."""

    def __init__(self, recipe: SensorRecipe, sensor: Sensor) -> None:
        """Connects and takes control. Errors as ``open_sensor``."""
        self.name = recipe.name
        self._recipe = recipe
        self._points, self._rate = recipe.shape(sensor)
        self._camera = Camera(recipe.name, recipe.address, recipe.heartbeat_ms)

    def identity(self) -> dict[str, str]:
        """Maker, model, serial, firmware, as the camera says. Errors as ``Control.read``."""
        return self._camera.control.identity()

    def start(self) -> Layout:
        """Look at the size of a frame, and stream.

        Raises:
            DeviceLost: no answer.
            DeviceError: no Mono16, another number of columns than the recipe's, or refused.
        """
        nodes = self._camera.nodes
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
        self._camera.start(
            layout.frame_bytes,
            2 * width,
            self._recipe.packet_size,
            self._recipe.packet_delay,
            self._recipe.resend,
            silence=max(SILENCE, 3 * height / self._rate),
        )
        return layout

    def next_frame(self, timeout: float) -> Frame | None:
        """As ``LineSensor``."""
        return self._camera.next_frame(timeout)

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

    def stop(self) -> None:
        """End the stream; frames that wait can still be taken. Errors as ``Control.read``."""
        self._camera.stop()

    def statistics(self) -> StreamStatistics:
        """How the stream went so far."""
        return self._camera.statistics()

    def close(self) -> None:
        """Stream ended, control given back; never raises for a camera that is gone."""
        self._camera.close()
