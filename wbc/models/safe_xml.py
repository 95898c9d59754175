"""Reading XML that came from anywhere: bounded in size, depth and number of elements, without entities."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from wbc.errors import ModelError
from wbc.files import located

MAX_BYTES = 50_000_000
MAX_ELEMENTS = 500_000
MAX_DEPTH = 50


def read_xml(path: Path, *roots: str) -> Element:
    """The root element of an XML file, which must be called one of ``roots``, where any are given.

    Raises:
        ModelError: no such file, not a plain file, too large, not UTF-8, not well formed, with a document type or
            entities, nested too deep, or another root.
    """
    if not located(path, ModelError).is_file():
        raise ModelError("there is no such file" if not path.exists() else "this is not a file")
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as cause:
        raise ModelError(f"the file cannot be read: {cause.strerror}") from None
    if len(content) > MAX_BYTES:
        raise ModelError(f"the file is larger than {MAX_BYTES // 1_000_000} MB")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise ModelError(f"the file is not UTF-8 text: byte {cause.start} is {content[cause.start]:#04x}") from None
    found = parse_xml(text)
    if roots and found.tag not in roots:
        allowed = " or ".join(f"<{root}>" for root in roots)
        raise ModelError(f"the file begins with <{str(found.tag)[:40]}>; it must be {allowed}{_advice(found.tag)}")
    return found


def parse_xml(text: str) -> Element:
    """The root element of a text.

    Raises:
        ModelError: as :func:`read_xml`.
    """
    # Entities are declared in a document type and nowhere else: without it, nothing expands and nothing is fetched.
    if "<!DOCTYPE" in text:
        raise ModelError("the file declares a document type (<!DOCTYPE); none is accepted")
    try:
        return ElementTree.fromstring(text, ElementTree.XMLParser(target=_Bounded()))
    except ElementTree.ParseError as cause:
        raise ModelError(f"not well-formed XML: {cause}") from None


class _Bounded(ElementTree.TreeBuilder):
    """A tree of elements that ends with an error where it gets too large."""

    depth = elements = 0

    def start(self, tag: Any, attrs: Any) -> Any:
        self.depth += 1
        self.elements += 1
        refuse_large(self.depth, self.elements)
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        self.depth -= 1
        return super().end(tag)


def refuse_large(depth: int, elements: int) -> None:
    """Bounds on a tree of elements.

    Raises:
        ModelError: it is nested too deep, or has too many elements.
    """
    if depth > MAX_DEPTH:
        raise ModelError(f"elements are nested more than {MAX_DEPTH} deep")
    if elements > MAX_ELEMENTS:
        raise ModelError(f"there are more than {MAX_ELEMENTS} elements")


def _advice(tag: str) -> str:
    return " (this is SDF; give a URDF)" if tag == "sdf" else ""
