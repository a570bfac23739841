"""The GenICam description of the virtual sensor, which it serves out of its memory."""

import re

from truestand.devices.wire.gvcp import TEXT_BYTES, Register
from truestand.devices.wire.gvsp import PixelFormat
from truestand.sim.live.faults import FaultKind
from truestand.sim.live.registers import MAX_PACKET_BYTES, MAX_TIME_10US, MIN_PACKET_BYTES, DeviceRegister

_HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<RegisterDescription ModelName="{model}" VendorName="truestand" ToolTip="Virtual laser line sensor"
 StandardNameSpace="GEV" SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0"
 MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
 ProductGuid="5b0f7a52-6d0e-4f0a-9d3e-7f3c6a1d2b11" VersionGuid="9c1f2e34-0a5b-4c6d-8e7f-102030405060"
 xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1 GenApiSchema_Version_1_1.xsd">"""


def description(model: str) -> bytes:
    """The XML of a sensor of this type."""
    features = {**_device(), **_image(), **_acquisition(), **_transport(), **_virtual()}
    listed = "".join(f"<pFeature>{name}</pFeature>" for name in features)
    root = f'<Category Name="Root" NameSpace="Standard">{listed}</Category>'
    port = '<Port Name="Device"/>'
    return "\n".join(
        [_HEAD.format(model=re.sub(r"\W", "_", model)), root, *features.values(), port, "</RegisterDescription>\n"]
    ).encode()


def _device() -> dict[str, str]:
    texts = (
        ("DeviceVendorName", Register.MANUFACTURER, "RO"),
        ("DeviceModelName", Register.MODEL, "RO"),
        ("DeviceVersion", Register.DEVICE_VERSION, "RO"),
        ("DeviceManufacturerInfo", Register.MANUFACTURER_INFO, "RO"),
        ("DeviceID", Register.SERIAL, "RO"),
        ("DeviceUserID", Register.USER_NAME, "RW"),
    )
    return {name: _node("StringReg", name, _location(at, mode, TEXT_BYTES[at])) for name, at, mode in texts}


def _image() -> dict[str, str]:
    return {
        "Width": _integer("Width", _bits(DeviceRegister.SIZE, 16, 31), 1, 32767),
        "Height": _integer("Height", _bits(DeviceRegister.SIZE, 0, 15), 1, 4095),
        "PixelFormat": _enumeration("PixelFormat", DeviceRegister.PIXEL_FORMAT, {"Mono16": PixelFormat.MONO16}),
        "PayloadSize": _integer("PayloadSize", _bits(DeviceRegister.PAYLOAD_SIZE, mode="RO")),
        "ProfileRearrangement": _integer("ProfileRearrangement", _bits(DeviceRegister.REARRANGEMENT)),
        "TransmissionType": _enumeration(
            "TransmissionType", DeviceRegister.TRANSMISSION, {"TypeProfile": 0, "TypeContainer": 1}
        ),
    }


def _acquisition() -> dict[str, str]:
    exposure = '<pVariable Name="EXPOSURE">ExposureTimeRaw</pVariable>'
    rate = _node(
        "Converter", "ProfileRate",
        f"{exposure}<FormulaTo>FLOOR(100000 / FROM - EXPOSURE + 0.5)</FormulaTo>"
        "<FormulaFrom>100000.0 / (TO + EXPOSURE)</FormulaFrom><pValue>IdleTimeRaw</pValue><Unit>Hz</Unit>"
        "<Slope>Decreasing</Slope>",
    )  # fmt: skip
    frames = _node(
        "SwissKnife", "AcquisitionFrameRate",
        f'{exposure}<pVariable Name="IDLE">IdleTimeRaw</pVariable><pVariable Name="HEIGHT">Height</pVariable>'
        "<Formula>100000.0 / ((EXPOSURE + IDLE) * HEIGHT)</Formula>",
    )  # fmt: skip
    return {
        "AcquisitionMode": _enumeration("AcquisitionMode", DeviceRegister.ACQUISITION_MODE, {"Continuous": 0}),
        "AcquisitionStart": _command("AcquisitionStart", _bits(DeviceRegister.ACQUISITION_START)),
        "AcquisitionStop": _command("AcquisitionStop", _bits(DeviceRegister.ACQUISITION_STOP)),
        "ExposureTimeRaw": _integer("ExposureTimeRaw", _bits(DeviceRegister.EXPOSURE), 1, MAX_TIME_10US),
        "IdleTimeRaw": _integer("IdleTimeRaw", _bits(DeviceRegister.IDLE), 1, MAX_TIME_10US),
        "ExposureTime": _ten_us("ExposureTime", "ExposureTimeRaw"),
        "IdleTime": _ten_us("IdleTime", "IdleTimeRaw"),
        "ProfileRate": rate,
        "AcquisitionFrameRate": frames,
        "LaserPower": _enumeration("LaserPower", DeviceRegister.LASER, {"Off": 0, "Reduced": 1, "Full": 2}),
        "TriggerRegister": _integer("TriggerRegister", _bits(DeviceRegister.TRIGGER)),
    }


def _transport() -> dict[str, str]:
    packet = Register.STREAM_PACKET_SIZE
    return {
        "TLParamsLocked": _node("Integer", "TLParamsLocked", "<Value>0</Value><Min>0</Min><Max>1</Max>"),
        "GevHeartbeatTimeout": _integer("GevHeartbeatTimeout", _bits(Register.HEARTBEAT), 500, 600000),
        "GevStreamChannelCount": _integer("GevStreamChannelCount", _bits(Register.STREAM_CHANNELS, mode="RO")),
        "GevSCPHostPort": _integer("GevSCPHostPort", _bits(Register.STREAM_PORT, 0, 15), 0, 65535),
        "GevSCPSPacketSize": _integer(
            "GevSCPSPacketSize", _bits(packet, 0, 15), MIN_PACKET_BYTES, MAX_PACKET_BYTES, step=4
        ),
        "GevSCPSDoNotFragment": _node(
            "Boolean", "GevSCPSDoNotFragment", "<pValue>GevSCPSDoNotFragmentReg</pValue>"
        ) + _node("MaskedIntReg", "GevSCPSDoNotFragmentReg", _bits(packet, 30, 30)),
        "GevSCPSFireTestPacket": _command("GevSCPSFireTestPacket", _bits(packet, 31, 31)),
        "GevSCPD": _integer("GevSCPD", _bits(Register.STREAM_DELAY)),
        "GevSCDA": _integer("GevSCDA", _bits(Register.STREAM_ADDRESS)),
        "GevSCSP": _integer("GevSCSP", _bits(Register.STREAM_SOURCE_PORT, mode="RO")),
        "GevTimestampTickFrequency": _integer("GevTimestampTickFrequency", _bits(Register.TICKS_LOW, mode="RO")),
        "GevTimestampControlLatch": _command("GevTimestampControlLatch", _bits(Register.TIMESTAMP_CONTROL), value=2),
        "GevTimestampValue": _node(
            "IntReg", "GevTimestampValue",
            _location(Register.TIMESTAMP_HIGH, "RO", 8) + _UNCACHED + "<Sign>Unsigned</Sign>" + _BIG,
        ),
    }  # fmt: skip


def _virtual() -> dict[str, str]:
    faults = {"".join(word.capitalize() for word in kind.name.split("_")): int(kind) for kind in FaultKind}
    return {
        "VirtualFault": _enumeration("VirtualFault", DeviceRegister.FAULT, faults),
        "VirtualLoss": _integer("VirtualLoss", _bits(DeviceRegister.LOSS), 0, 1000),
        "VirtualLatency": _integer("VirtualLatency", _bits(DeviceRegister.LATENCY), 0, 60000),
        "VirtualMounted": _enumeration("VirtualMounted", DeviceRegister.MOUNTED, {"Shaft": 0, "Part": 1}),
    }


_UNCACHED, _BIG = "<Cachable>NoCache</Cachable>", "<Endianess>BigEndian</Endianess>"


def _node(kind: str, name: str, content: str) -> str:
    return f'<{kind} Name="{name}">{content}</{kind}>\n'


def _location(address: int, mode: str, size: int = 4) -> str:
    return (
        f"<Address>0x{address:08x}</Address><Length>{size}</Length><AccessMode>{mode}</AccessMode><pPort>Device</pPort>"
    )


def _bits(address: int, low: int = 0, high: int = 31, mode: str = "RW") -> str:
    """Bits of a register, bit 0 = the lowest (GenICam counts big-endian registers from the other end)."""
    bits = f"<LSB>{31 - low}</LSB><MSB>{31 - high}</MSB>"
    return _location(address, mode) + _UNCACHED + bits + "<Sign>Unsigned</Sign>" + _BIG


def _integer(name: str, location: str, lowest: int = 0, highest: int = 0xFFFFFFFF, step: int = 1) -> str:
    limits = f"<Min>{lowest}</Min><Max>{highest}</Max><Inc>{step}</Inc>"
    return _node("Integer", name, f"<pValue>{name}Reg</pValue>{limits}") + _node("MaskedIntReg", f"{name}Reg", location)


def _ten_us(name: str, of: str) -> str:
    """A time in us of a register that counts 10 us."""
    formulas = "<FormulaTo>FLOOR(FROM / 10 + 0.5)</FormulaTo><FormulaFrom>TO * 10.0</FormulaFrom>"
    return _node("Converter", name, f"{formulas}<pValue>{of}</pValue><Unit>us</Unit><Slope>Increasing</Slope>")


def _enumeration(name: str, address: int, entries: dict[str, int]) -> str:
    listed = "".join(_node("EnumEntry", key, f"<Value>{int(value)}</Value>") for key, value in entries.items())
    return _node("Enumeration", name, f"{listed}<pValue>{name}Reg</pValue>") + _node(
        "MaskedIntReg", f"{name}Reg", _bits(address)
    )


def _command(name: str, location: str, value: int = 1) -> str:
    return _node("Command", name, f"<pValue>{name}Reg</pValue><CommandValue>{value}</CommandValue>") + _node(
        "MaskedIntReg", f"{name}Reg", location
    )
