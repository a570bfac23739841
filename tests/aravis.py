"""libaravis' GigE Vision client through ctypes: an implementation of the protocol that nobody here wrote."""

import ctypes
from ctypes import (
    POINTER,
    byref,
    c_bool,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_size_t,
    c_uint,
    c_uint32,
    c_uint64,
    c_void_p,
)

import pytest

NAME = "libaravis-0.8.so.0"


NO_PACKET_SOCKET = 1
"""Stream option. As root the library sniffs the interface, and takes what others send there for the camera's."""


class GError(ctypes.Structure):
    _fields_ = [("domain", c_uint32), ("code", c_int), ("message", c_char_p)]


class AravisError(Exception):
    pass


def library():
    """The library with its functions' types, or a skip with the reason."""
    try:
        arv = ctypes.CDLL(NAME)
    except OSError:
        pytest.skip(f"{NAME} is not installed (apt-get install libaravis-0.8-0)")
    error = POINTER(POINTER(GError))
    for name, result, *arguments in (
        ("arv_gv_device_new", c_void_p, c_void_p, c_void_p, error),
        ("arv_gv_device_set_stream_options", None, c_void_p, c_int),
        ("arv_gv_device_get_timestamp_tick_frequency", c_uint64, c_void_p, error),
        ("arv_gv_device_set_packet_size", None, c_void_p, c_int, error),
        ("arv_gv_device_auto_packet_size", c_uint, c_void_p, error),
        ("arv_gv_device_is_controller", c_bool, c_void_p),
        ("arv_gv_device_take_control", c_bool, c_void_p, error),
        ("arv_device_get_integer_feature_value", c_int64, c_void_p, c_char_p, error),
        ("arv_device_set_integer_feature_value", None, c_void_p, c_char_p, c_int64, error),
        ("arv_device_get_float_feature_value", c_double, c_void_p, c_char_p, error),
        ("arv_device_set_float_feature_value", None, c_void_p, c_char_p, c_double, error),
        ("arv_device_get_string_feature_value", c_char_p, c_void_p, c_char_p, error),
        ("arv_device_set_string_feature_value", None, c_void_p, c_char_p, c_char_p, error),
        ("arv_device_execute_command", None, c_void_p, c_char_p, error),
        ("arv_device_read_register", c_bool, c_void_p, c_uint64, POINTER(c_uint32), error),
        ("arv_device_write_register", c_bool, c_void_p, c_uint64, c_uint32, error),
        ("arv_device_create_stream", c_void_p, c_void_p, c_void_p, c_void_p, error),
        ("arv_stream_push_buffer", None, c_void_p, c_void_p),
        ("arv_stream_timeout_pop_buffer", c_void_p, c_void_p, c_uint64),
        ("arv_stream_get_statistics", None, c_void_p, POINTER(c_uint64), POINTER(c_uint64), POINTER(c_uint64)),
        ("arv_gv_stream_get_statistics", None, c_void_p, POINTER(c_uint64), POINTER(c_uint64)),
        ("arv_buffer_new_allocate", c_void_p, c_size_t),
        ("arv_buffer_get_status", c_int, c_void_p),
        ("arv_buffer_get_data", c_void_p, c_void_p, POINTER(c_size_t)),
        ("arv_buffer_get_frame_id", c_uint64, c_void_p),
        ("arv_buffer_get_timestamp", c_uint64, c_void_p),
        ("arv_buffer_get_image_width", c_int, c_void_p),
        ("arv_buffer_get_image_height", c_int, c_void_p),
    ):
        function = getattr(arv, name)
        function.restype, function.argtypes = result, arguments
    return arv


class Client:
    """A connection to the device at ``address``, with control of it."""

    def __init__(self, address, interface="127.0.0.1"):
        self.arv = library()
        gio, self.gobject = ctypes.CDLL("libgio-2.0.so.0"), ctypes.CDLL("libgobject-2.0.so.0")
        gio.g_inet_address_new_from_string.restype = c_void_p
        self.gobject.g_object_unref.argtypes = [c_void_p]
        ends = [gio.g_inet_address_new_from_string(a.encode()) for a in (interface, address)]
        self.stream = None
        self.device = None
        self.device = self.call("arv_gv_device_new", *(c_void_p(e) for e in ends), on=())
        self.arv.arv_gv_device_set_stream_options(self.device, NO_PACKET_SOCKET)
        for end in ends:
            self.gobject.g_object_unref(end)

    def call(self, name, *arguments, on=None):
        error = POINTER(GError)()
        first = (self.device,) if on is None else on
        result = getattr(self.arv, name)(*first, *arguments, byref(error))
        if error:
            raise AravisError(f"{name}: {error.contents.message.decode()}")
        return result

    def integer(self, name, value=None):
        if value is not None:
            self.call("arv_device_set_integer_feature_value", name.encode(), value)
        return self.call("arv_device_get_integer_feature_value", name.encode())

    def number(self, name, value=None):
        if value is not None:
            self.call("arv_device_set_float_feature_value", name.encode(), value)
        return self.call("arv_device_get_float_feature_value", name.encode())

    def text(self, name, value=None):
        if value is not None:
            self.call("arv_device_set_string_feature_value", name.encode(), value.encode())
        return self.call("arv_device_get_string_feature_value", name.encode()).decode()

    def command(self, name):
        self.call("arv_device_execute_command", name.encode())

    def register(self, address, value=None):
        if value is not None:
            self.call("arv_device_write_register", address, value)
        found = c_uint32()
        self.call("arv_device_read_register", address, byref(found))
        return found.value

    def start(self, buffers=50):
        """Create the stream and begin."""
        self.stream = self.call("arv_device_create_stream", None, None)
        for name, value in (
            (b"socket-buffer", c_int(0)),
            (b"socket-buffer-size", c_int(4_000_000)),
            (b"packet-request-ratio", c_double(1.0)),
            (b"frame-retention", c_uint(1_000_000)),
        ):
            self.gobject.g_object_set(c_void_p(self.stream), name, value, None)
        for _ in range(buffers):
            self.arv.arv_stream_push_buffer(self.stream, self.arv.arv_buffer_new_allocate(self.integer("PayloadSize")))
        self.command("AcquisitionStart")

    def frame(self, timeout=1.0):
        """(status, frame id, bytes) of the next frame, or None; status 0 = whole."""
        buffer = self.arv.arv_stream_timeout_pop_buffer(self.stream, int(timeout * 1e6))
        if not buffer:
            return None
        size = c_size_t()
        data = self.arv.arv_buffer_get_data(buffer, byref(size))
        found = (
            self.arv.arv_buffer_get_status(buffer),
            self.arv.arv_buffer_get_frame_id(buffer),
            ctypes.string_at(data, size.value) if data else b"",
        )
        self.arv.arv_stream_push_buffer(self.stream, buffer)
        return found

    def statistics(self):
        """Frames whole, failed, and without a buffer; packets resent and missing."""
        numbers = [c_uint64() for _ in range(5)]
        self.arv.arv_stream_get_statistics(self.stream, *(byref(n) for n in numbers[:3]))
        self.arv.arv_gv_stream_get_statistics(self.stream, *(byref(n) for n in numbers[3:]))
        return tuple(n.value for n in numbers)

    def close(self):
        for thing in (self.stream, self.device):
            if thing:
                self.gobject.g_object_unref(thing)
        self.stream = self.device = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
