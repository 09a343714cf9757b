"""Digital calibration certificates (DCC) of the bar, the force device and the balls.

The numbers of a certificate are returned as dictionaries with the keys of ``campaign.toml``. They
are later stored in fields of `Instrument`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.ball_certificate import ball_fields
from ldbb_bayes.campaign.bar_certificate import bar_fields
from ldbb_bayes.campaign.certified_quantity import CertifiedQuantity, title_with_holder
from ldbb_bayes.campaign.force_certificate import force_fields
from ldbb_bayes.errors import check_known, placed
from ldbb_bayes.results import Shown

__all__ = ["CalibrationCertificate"]

# Longest name of a certificate that is written into campaign.toml [characters].
_LONGEST_LABEL = 200


@dataclass(frozen=True)
class CalibrationCertificate(Shown):
    """Digital calibration certificate (DCC): its identifier and its numbers.

    The method ``fields`` returns a dictionary of what the certificate states about a bar, a force
    device or a ball, with the keys of ``campaign.toml``.
    """

    path: Path
    identifier: str
    quantities: tuple[CertifiedQuantity, ...]

    def fields(self, kind: str, *, bar_length_mm: float | None = None) -> dict[str, Any]:
        """Return what the certificate states about a bar, a force device or a ball.

        Parameters
        ----------
        kind
            Kind of object: ``bar``, ``force`` (force device) or ``ball``.
        bar_length_mm
            Nominal length of the bar [mm]. This length is used to choose a bar if the certificate
            describes several bars.

        Returns
        -------
        Dictionary of certified values, with the keys of the object's table in campaign.toml.

        Raises
        ------
        InputError
            If there is no such ``kind``, or if the certificate states nothing about the object; the
            message then names the file.
        """
        check_known("kind of certified object", [kind], ("bar", "force", "ball"))
        with placed(self.path):
            if kind == "bar":
                certified = bar_fields(self.quantities, bar_length_mm)
            elif kind == "force":
                certified = force_fields(self.quantities)
            else:
                certified = ball_fields(self.quantities)
        name = self._certificate_name(certified.quantities)
        return {**certified.values, "certificate": name}

    def _certificate_name(self, quantities: Sequence[CertifiedQuantity]) -> str:
        """Return a name for this calibration certificate, on one line, for campaign.toml.

        The name has at most 200 characters. It consists of the file's name, the identifier of the
        certificate and the names of ``quantities``, the certified quantities that are used.
        """
        titles = ", ".join(title_with_holder(quantity) for quantity in quantities)
        text = f"{self.path.name}, DCC {self.identifier}: {titles}"
        label = ""
        for sign in text[:_LONGEST_LABEL]:
            label += sign if sign.isprintable() else " "
        return label
