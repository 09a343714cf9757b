"""Reading of XML that is not trusted: document types, entities and deep nesting are refused."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.parsers import expat

from ldbb_bayes.errors import InputError, require

__all__ = ["xml_of"]

# Largest number of XML elements that may be nested in one another.
_MAX_DEPTH = 100


def xml_of(content: bytes, wanted: str) -> ElementTree.Element:
    """Return the root element of an XML file.

    Parameters
    ----------
    content
        Content of the file.
    wanted
        Description of the file that the user should give, for the error message.

    Returns
    -------
    xml.etree.ElementTree.Element
        Root element of the XML tree.

    Raises
    ------
    InputError
        For content that is not XML, has a document type, or is nested too deeply.
    """
    try:
        _refuse_dangerous(content)
        return ElementTree.fromstring(content)
    except InputError:
        raise
    except (expat.ExpatError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise InputError(f"the file must be XML, got: {error}. Give {wanted}.") from None


def _refuse_dangerous(content: bytes) -> None:
    """Raise an `InputError` for XML with a document type or too deeply nested elements.

    This function must be called before the tree of elements is built, because such XML could make
    the tree very large.
    """
    depth = 0

    def refuse_document_type(*_: object) -> None:
        """Raise an `InputError`, because the XML file declares a document type."""
        raise InputError(
            "the file must have no document type (DTD), got one. Remove <!DOCTYPE …> and its"
            " entities."
        )

    def enter_element(*_: object) -> None:
        """Increase the depth by one at the start of an XML element; refuse too great a depth."""
        nonlocal depth
        depth += 1
        require(
            depth <= _MAX_DEPTH,
            f"its elements must be nested at most {_MAX_DEPTH} deep, got more. Ask for another"
            " file.",
        )

    def leave_element(*_: object) -> None:
        """Decrease the depth of nested XML elements by one at the end of an element."""
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse_document_type
    parser.StartElementHandler = enter_element
    parser.EndElementHandler = leave_element
    parser.Parse(content, True)
