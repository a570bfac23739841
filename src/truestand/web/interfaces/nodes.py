"""The address space: objects and variables with names for node ids, which stay the same from result to result.

A client may subscribe to ``LastResult/Characteristics/F_p left/Value`` once and for all. A value that has not changed
isn't written, so that nobody is notified twice; a value that is missing is Null, never NaN.
"""

from collections.abc import Collection, Mapping
from datetime import datetime
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.manage_nodes import delete_nodes

Kind = ua.VariantType
TEXTS = Kind.Variant
"""Of a variable: an array of texts."""
Value = str | bool | int | float | datetime | list[str] | None


class Nodes:
    """The objects of one namespace."""

    def __init__(self, server: Server, space: int) -> None:
        self._server, self._space = server, space
        self._nodes: dict[str, Node] = {}
        self._kinds: dict[str, ua.VariantType] = {}
        self._values: dict[str, Value] = {}

    def __contains__(self, path: str) -> bool:
        return path in self._nodes

    def children(self, path: str) -> list[str]:
        """Paths of the objects that were added under one."""
        return [at for at in self._nodes if at.startswith(f"{path}/") and at not in self._kinds]

    async def add_object(self, path: str, kinds: Mapping[str, ua.VariantType], folder: bool = False) -> None:
        """An object under the one that its path names; at the top under Objects.

        ``kinds``: its variables by name, Null at first, that clients can't write.
        """
        parent, name = self._parent_and_name(path)
        add = parent.add_folder if folder else parent.add_object
        self._nodes[path] = await add(self._id(path), ua.QualifiedName(name, self._space))
        for name, kind in kinds.items():
            at, several = f"{path}/{name}", kind is TEXTS
            datatype = _type(Kind.String if several else kind)
            qualified = ua.QualifiedName(name, self._space)
            node = await self._nodes[path].add_variable(self._id(at), qualified, None, Kind.Null, datatype)
            if several:
                rank = ua.DataValue(ua.Variant(ua.ValueRank.OneDimension, Kind.Int32))
                await self._server.write_attribute_value(node.nodeid, rank, ua.AttributeIds.ValueRank)
            self._nodes[at], self._kinds[at], self._values[at] = node, kind, None

    async def add_method(self, path: str, call: Any, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> None:
        """A method with texts in and out, by name with a description."""
        parent, name = self._parent_and_name(path)
        arguments = [[_argument(*item) for item in side.items()] for side in (inputs, outputs)]
        self._nodes[path] = await parent.add_method(
            self._id(path), ua.QualifiedName(name, self._space), call, *arguments
        )

    async def write(self, path: str, values: Mapping[str, Value]) -> None:
        """Write those values of an object's variables that have changed."""
        for name, value in values.items():
            at = f"{path}/{name}"
            if value == self._values[at] and type(value) is type(self._values[at]):
                continue
            self._values[at] = value
            self._clear(self._nodes[at])
            variant = ua.Variant(None, Kind.Null) if value is None else _variant(value, self._kinds[at])
            await self._server.write_attribute_value(self._nodes[at].nodeid, ua.DataValue(variant))

    async def remove(self, parent: str, paths: Collection[str]) -> None:
        """Remove objects of a parent with their variables."""
        removed = [at for at in self._nodes if at in paths or (at in self._kinds and at.rpartition("/")[0] in paths)]
        nodes = [self._nodes[at] for at in removed]
        # asyncua would look for references through the whole address space, 20 ms a node
        await delete_nodes(self._server.iserver.isession, nodes, False, False)
        ids = {node.nodeid for node in nodes}
        references = self._server.iserver.aspace[self._nodes[parent].nodeid].references
        references[:] = [reference for reference in references if reference.NodeId not in ids]
        for at in removed:
            for by_path in (self._nodes, self._kinds, self._values):
                by_path.pop(at, None)

    def _clear(self, node: Node) -> None:
        """asyncua refuses to write Null over a value, but not anything over no value."""
        self._server.iserver.aspace[node.nodeid].attributes[ua.AttributeIds.Value].value = None

    def _parent_and_name(self, path: str) -> tuple[Node, str]:
        parent = max((at for at in self._nodes if path.startswith(f"{at}/")), key=len, default=None)
        return (self._server.nodes.objects, path) if parent is None else (self._nodes[parent], path[len(parent) + 1 :])

    def _id(self, path: str) -> ua.NodeId:
        return ua.NodeId(ua.String(path), ua.Int16(self._space))


def _type(kind: ua.VariantType) -> ua.NodeId:
    return ua.NodeId(ua.Int32(kind.value))


def _variant(value: Value, kind: ua.VariantType) -> ua.Variant:
    if kind is TEXTS:
        return ua.Variant(value, Kind.String, is_array=True)
    return ua.Variant(float(value) if kind is Kind.Double else value, kind)  # type: ignore[arg-type]


def _argument(name: str, description: str) -> ua.Argument:
    return ua.Argument(
        Name=name,
        DataType=_type(Kind.String),
        ValueRank=ua.ValueRank.Scalar,
        ArrayDimensions=[],
        Description=ua.LocalizedText(description),
    )
