"""Digital calibration certificates of others: a German one written by hand, and what is none."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaigns import cases, refuses
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli import app
from ldbb_bayes.cli.arguments import instrument_fields

from .test_folder import TOML, write

CASES = cases(__file__, "certificates.toml")

SCHEIN = Path(__file__).with_name("kalibrierschein.xml")
NAME = "kalibrierschein.xml, DCC K-2026-0815: "


def changed(folder: Path, *changes: tuple[str, str]) -> Path:
    text = SCHEIN.read_text("utf-8").replace("UTF-8", "ISO-8859-1")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "schein.xml"
    path.write_text(text, "iso-8859-1")
    return path


def test_a_german_certificate(tmp_path: Path) -> None:
    """A bar 0.8 µm too long reads 0.8 µm too small; U = 0.9 µm (k = 3) is 0.6 µm (k = 2)."""
    certificate = lb.campaign.read_dcc(SCHEIN)
    assert (certificate.identifier, len(certificate.quantities)) == ("K-2026-0815", 8)
    assert certificate.fields("bar") == {
        "length_error_um": -0.8,
        "U_um": 0.6,
        "certificate": f"{NAME}Längenabweichung vom Nennmaß: Messwert",
    }
    named = f"{NAME}Prüfkraft: Kraft, Prüfkraft: Linearitätsabweichung"
    assert certificate.fields("force") == {
        "U_percent": 0.5,
        "linearity_percent": 0.6,
        "certificate": named,
    }
    assert certificate.fields("ball") == {
        "sphericity_um": 0.15,
        "certificate": f"{NAME}Rundheitsabweichung / Roundness: Ebene 2",
    }
    indication = changed(tmp_path, ("Längenabweichung vom Nennmaß", "Error of indication"))
    assert lb.campaign.read_dcc(indication).fields("bar")["length_error_um"] == 0.8
    length = changed(tmp_path, ("Längenabweichung vom Nennmaß", "Length"), (">0.8<", ">150000.8<"))
    assert lb.campaign.read_dcc(length).fields("bar")["length_error_um"] == pytest.approx(
        -0.8, rel=1e-9
    )


def test_a_certificate_of_an_unknown_kind_of_object_is_refused() -> None:
    certificate = lb.campaign.read_dcc(SCHEIN)
    refuses("must be one of bar, force, ball, got 'balls'", certificate.fields, "balls")


def test_a_bar_of_another_nominal_length_is_refused() -> None:
    """The certificate is of a bar of 150 mm."""
    certificate = lb.campaign.read_dcc(SCHEIN)
    assert certificate.fields("bar", bar_length_mm=150.0)["length_error_um"] == -0.8
    named = "must be of a bar of radius_mm = 100, got 150 mm beside 'Messwert'"
    refuses(named, certificate.fields, "bar", bar_length_mm=100.0)


@pytest.mark.parametrize("name", ["Längenkorrektion", "Length correction", "Berichtigung (Länge)"])
def test_a_correction_of_the_length_is_no_length(tmp_path: Path, name: str) -> None:
    """0.8 µm less the nominal 150 mm would be an error of 15 cm, and of the wrong sign."""
    certificate = lb.campaign.read_dcc(changed(tmp_path, ("Längenabweichung vom Nennmaß", name)))
    refuses("must state the error of a bar's length", certificate.fields, "bar")


@pytest.mark.parametrize(
    ("name", "error_um"),
    [("Indication", 0.8), ("Length deviation", -0.8), ("Bar 150 mm: indication", 0.8)],
)
def test_an_indicated_length_is_no_error_of_it(tmp_path: Path, name: str, error_um: float) -> None:
    """150000.8 µm beside the nominal 150 mm; as an error it would be 15 cm."""
    path = changed(tmp_path, ("Längenabweichung vom Nennmaß", name), (">0.8<", ">150000.8<"))
    fields = lb.campaign.read_dcc(path).fields("bar")
    assert fields["length_error_um"] == pytest.approx(error_um, rel=1e-9)


@pytest.mark.parametrize("nominal", ["Länge", "Nennlänge"])
def test_an_error_of_more_than_a_millimetre_is_refused(tmp_path: Path, nominal: str) -> None:
    """An indication of 140 mm beside a length that is not named nominal, and beside 150 mm."""
    ref_type = "basic_nominalValue" if nominal == "Nennlänge" else "basic_referenceValue"
    path = changed(
        tmp_path,
        ("Längenabweichung vom Nennmaß", "Indication"),
        ("Nennlänge", nominal),
        ("basic_nominalValue", ref_type),
        (">0.8<", ">140000<"),
    )
    named = "the error of the bar's length must be at most 1000 µm, got .* µm from 'Messwert'"
    refuses(named, lb.campaign.read_dcc(path).fields, "bar")


def test_a_diameter_is_no_form(tmp_path: Path) -> None:
    """A diameter of 0.00011 mm stands below the title Roundness."""
    certificate = lb.campaign.read_dcc(changed(tmp_path, ("Ebene 2", "Durchmesser")))
    assert certificate.fields("ball")["sphericity_um"] < 0.15


FORCE_NUMBER = (
    "<dcc:quantity><dcc:name><dcc:content>{name}</dcc:content></dcc:name><si:real><si:value>{value}"
    r"</si:value><si:unit>\newton</si:unit><si:measurementUncertaintyUnivariate><si:expandedMU>"
    "<si:valueExpandedMU>{U}</si:valueExpandedMU><si:coverageFactor>2</si:coverageFactor>"
    "</si:expandedMU></si:measurementUncertaintyUnivariate></si:real></dcc:quantity>"
)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Anzeigeabweichung der Kraft", 5.0),
        ("Force deviation", -5.0),
        ("Indication of force", 805.0),
    ],
)
def test_the_U_of_a_force_is_not_that_of_the_reference(
    tmp_path: Path, name: str, value: float
) -> None:
    """Beside a force of 800 N known to 4 N stands how far the device deviates, known to 8 N. The
    forces of a campaign are not corrected for these 5 N."""
    deviation = FORCE_NUMBER.format(name=name, value=value, U=8.0)
    linearity = '<dcc:quantity><dcc:name><dcc:content lang="de">Linearitätsabweichung'
    certificate = lb.campaign.read_dcc(changed(tmp_path, (linearity, deviation + linearity)))
    stated = certificate.fields("force")
    assert stated["U_percent"] == pytest.approx(100.0 * (5.0 + 8.0) / 800.0, rel=1e-9)
    assert f"{name}," in stated["certificate"]


FORCE_NUMBERS = (
    "<dcc:quantity><dcc:name><dcc:content>{name}</dcc:content></dcc:name><si:realListXMLList>"
    r"<si:valueXMLList>{values}</si:valueXMLList><si:unitXMLList>{unit}</si:unitXMLList>{U}"
    "</si:realListXMLList></dcc:quantity>"
)
U_NUMBERS = (
    "<si:measurementUncertaintyUnivariateXMLList><si:expandedMUXMLList><si:valueExpandedMUXMLList>"
    "{U}</si:valueExpandedMUXMLList><si:coverageFactorXMLList>2</si:coverageFactorXMLList>"
    "</si:expandedMUXMLList></si:measurementUncertaintyUnivariateXMLList>"
)


@pytest.mark.parametrize(
    ("name", "values", "unit", "U", "largest_N"),
    [
        ("Indication of force", "101 403 805", r"\newton", "2 4 8", 5.0 + 8.0),
        ("Indication of force", "101 101 403 403 805 805", r"\newton", "8", 5.0 + 8.0),
        ("Force deviation", "45 3 5", r"\newton", "2 4 8", 45.0 + 2.0),
        ("Relative deviation", "1.0 3.0 0.6", r"\percent", "2 1.5 1", 4.0 * (3.0 + 1.5)),
        ("Relative deviation", "1.0", r"\percent", "2", 8.0 * (1.0 + 2.0)),
        ("Force deviation", "1 3 5", r"\newton", "", 5.0 + 4.0),
        ("Angle deviation", "1 1 1", r"\degree", "1", 4.0),
    ],
)
def test_each_deviation_is_that_of_its_force(
    tmp_path: Path, name: str, values: str, unit: str, U: str, largest_N: float
) -> None:
    """The device is compared with 100 N, 400 N and 800 N, the last known to 4 N."""
    uncertainty = U_NUMBERS.format(U=U) if U else ""
    deviation = FORCE_NUMBERS.format(name=name, values=values, unit=unit, U=uncertainty)
    linearity = '<dcc:quantity><dcc:name><dcc:content lang="de">Linearitätsabweichung'
    certificate = lb.campaign.read_dcc(changed(tmp_path, (linearity, deviation + linearity)))
    stated = certificate.fields("force")
    assert stated["U_percent"] == pytest.approx(100.0 * largest_N / 800.0, rel=1e-9)


@pytest.mark.parametrize(
    ("U", "k", "largest_N"),
    [("0.006 0.003 0.002", "2", 6.0), ("0.002 0.003 0.004", "2 2 4", 3.0)],
)
def test_the_largest_U_need_not_be_that_of_the_largest_force(
    tmp_path: Path, U: str, k: str, largest_N: float
) -> None:
    """U of 100 N, 400 N and 800 N in kN; the second time U of 800 N is given with k = 4."""
    factor = "<si:coverageFactorXMLList>{}</si:coverageFactorXMLList>"
    path = changed(tmp_path, ("0.002 0.003 0.004", U), (factor.format("2"), factor.format(k)))
    stated = lb.campaign.read_dcc(path).fields("force")
    assert stated["U_percent"] == pytest.approx(100.0 * largest_N / 800.0, rel=1e-9)


def test_of_two_linearities_the_larger_share_of_the_force_counts(tmp_path: Path) -> None:
    """A ratio of 1 % is more than 4.8 N of 800 N."""
    end = "</si:unit></si:real></dcc:quantity>"
    newtons = rf"<si:value>-4.8</si:value><si:unit>\newton{end}"
    percent = (
        r"<dcc:quantity><dcc:name><dcc:content>Linearity</dcc:content></dcc:name>"
        rf"<si:real><si:value>1.0</si:value><si:unit>\percent{end}"
    )
    certificate = lb.campaign.read_dcc(changed(tmp_path, (newtons, newtons + percent)))
    assert certificate.fields("force")["linearity_percent"] == 1.0


BAR_NUMBER = (
    r"<si:real><si:value>{value}</si:value><si:unit>{unit}</si:unit>"
    r"<si:measurementUncertaintyUnivariate><si:expandedMU><si:valueExpandedMU>{U}"
    r"</si:valueExpandedMU><si:coverageFactor>3</si:coverageFactor><si:coverageProbability>0.997"
    r"</si:coverageProbability></si:expandedMU>{more}</si:measurementUncertaintyUnivariate>"
    r"</si:real>"
)


def certificate_of_bar(folder: Path, numbers: str) -> lb.campaign.CalibrationCertificate:
    """Return the German certificate with other XML for the number of the bar's deviation."""
    text = SCHEIN.read_text("utf-8")
    start = text.index("<si:real>", text.index("Messwert"))
    end = text.index("</si:real>", start) + len("</si:real>")
    path = folder / "schein.xml"
    path.write_text(text[:start] + numbers + text[end:], "utf-8")
    return lb.campaign.read_dcc(path)


@pytest.mark.parametrize(
    "units",
    [
        (r"\micro\metre", r"\milli\metre"),
        (r"\milli\metre", r"\micro\metre"),
        ("µ", r"\micro\metre"),
    ],
)
def test_a_hybrid_is_one_quantity_in_several_units(tmp_path: Path, units: tuple[str, str]) -> None:
    alternatives = ""
    for unit in units:
        micrometres = 1000.0 if unit == r"\milli\metre" else 1.0
        alternatives += BAR_NUMBER.format(
            value=0.8 / micrometres, unit=unit, U=0.9 / micrometres, more=""
        )
    certificate = certificate_of_bar(tmp_path, f"<si:hybrid>{alternatives}</si:hybrid>")
    assert len(certificate.quantities) == 8
    fields = certificate.fields("bar")
    assert (fields["length_error_um"], fields["U_um"]) == (-0.8, 0.6)


HOLDER = (
    "<dcc:result><dcc:name><dcc:content>{name}</dcc:content></dcc:name><dcc:data>"
    "<dcc:quantity><dcc:name><dcc:content>Deviation of length</dcc:content></dcc:name>"
    "{number}</dcc:quantity></dcc:data></dcc:result>"
)


def certificate_of(folder: Path, deviations_um: dict[str, float]) -> Path:
    """Return a certificate that states a bar's deviation once for each holder, U = 0.9 (k = 3)."""
    results = ""
    for name, deviation_um in deviations_um.items():
        number = BAR_NUMBER.format(value=deviation_um, unit=r"\micro\metre", U=0.9, more="")
        results += HOLDER.format(name=name, number=number)
    path = folder / "twice.xml"
    path.write_text(
        '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc"'
        ' xmlns:si="https://ptb.de/si"><dcc:measurementResults><dcc:measurementResult>'
        f"<dcc:results>{results}</dcc:results></dcc:measurementResult></dcc:measurementResults>"
        "</dcc:digitalCalibrationCertificate>",
        "utf-8",
    )
    return path


BARS = {"Ball bar 100 mm": 0.8, "Ball bar 150 mm": -0.4}


@pytest.mark.parametrize(("length_mm", "error_um"), [(100.0, -0.8), (150.0, 0.4)])
def test_of_two_bars_that_of_the_campaign_counts(
    tmp_path: Path, length_mm: float, error_um: float
) -> None:
    certificate = lb.campaign.read_dcc(certificate_of(tmp_path, BARS))
    fields = certificate.fields("bar", bar_length_mm=length_mm)
    assert fields["length_error_um"] == error_um


def test_two_bars_without_a_length_are_named_with_their_numbers(tmp_path: Path) -> None:
    certificate = lb.campaign.read_dcc(certificate_of(tmp_path, BARS))
    named = "'Ball bar 100 mm' .length_error_um -0.8, U_um 0.6., 'Ball bar 150 mm' .length_error_um"
    refuses(named, certificate.fields, "bar")


def test_as_found_and_as_left_are_named_with_their_numbers(tmp_path: Path) -> None:
    certificate = lb.campaign.read_dcc(certificate_of(tmp_path, {"As found": 2.5, "As left": 0.1}))
    named = "'As found' .length_error_um -2.5, U_um 0.6., 'As left' .length_error_um -0.1"
    refuses(named, certificate.fields, "bar", bar_length_mm=150.0)


def test_the_radius_of_a_campaign_chooses_the_bar(tmp_path: Path, recovered: lb.Campaign) -> None:
    lb.write_campaign(recovered, tmp_path / "c")
    certificate_of(tmp_path / "c", BARS)
    toml = tmp_path / "c" / "campaign.toml"
    text = toml.read_text("utf-8")
    toml.write_text(text.replace("[[test]]", '[bar]\ndcc = "twice.xml"\n\n[[test]]', 1), "utf-8")
    assert lb.read_campaign(tmp_path / "c").instrument.bar_length_error_um == 0.4


def test_the_numbers_that_a_refusal_names_can_be_given(tmp_path: Path) -> None:
    certificate = certificate_of(tmp_path, {"As found": 2.5, "As left": 0.1})
    recovered = str(lb.embedded_campaign())
    refused = CliRunner().invoke(app, ["check", recovered, "--bar-dcc", str(certificate)])
    assert refused.exit_code == 2
    assert "by hand instead of the DCC" in " ".join(refused.output.split())
    numbers = ["--bar-length-error-um", "-0.1", "--bar-U-um", "0.6"]
    assert CliRunner().invoke(app, ["check", recovered, *numbers]).exit_code == 0


def test_a_hybrid_of_unknown_units_is_refused_with_its_first_unit(tmp_path: Path) -> None:
    alternatives = ""
    for unit in ("µ", "mu"):
        alternatives += BAR_NUMBER.format(value=0.8, unit=unit, U=0.9, more="")
    certificate = certificate_of_bar(tmp_path, f"<si:hybrid>{alternatives}</si:hybrid>")
    refuses("must be of D-SI .*, got 'µ'", certificate.fields, "bar")


def test_an_uncertainty_without_a_number_leaves_the_earlier_one(tmp_path: Path) -> None:
    empty = "<si:standardMU><si:valueStandardMU/></si:standardMU>"
    numbers = BAR_NUMBER.format(value=0.8, unit=r"\micro\metre", U=0.9, more=empty)
    assert certificate_of_bar(tmp_path, numbers).fields("bar")["U_um"] == 0.6


def instrument_shown(*arguments: str) -> str:
    """What `check` prints of the instrument."""
    text = CliRunner().invoke(app, ["check", *arguments]).stdout
    return text[text.index("What a fit assumes of the instrument") :]


def test_a_note_on_assumed_lobes_stands_only_where_lobes_are_assumed(
    recovered: lb.Campaign,
) -> None:
    stated = lb.Ball(grade="G20")
    both_stated = replace(recovered, instrument=lb.Instrument(work=stated, tool=stated))
    one_stated = replace(recovered, instrument=lb.Instrument(work=stated))
    assert "Assumed lobes" not in str(lb.terms.uncertainties(both_stated))
    assert "Assumed lobes" in str(lb.terms.uncertainties(one_stated))


def test_the_note_on_assumed_lobes_says_why_sheets_state_more(recovered: lb.Campaign) -> None:
    """The u of the table is that of the assumed sphericity of 2.5 µm alone; the prior of a fit adds
    what τ, the form that higher orders show, lets it expect of the order."""
    assumed = lb.terms.uncertainties(recovered)
    alone_um = 1e3 * assumed.assumed[0].sd
    assert alone_um == pytest.approx(2.5 / np.sqrt(24.0))
    with_form_um = lb.terms.BallForm().coefficient_sd_um(lb.Ball(), 2, 0.3, 2.0)
    assert with_form_um**2 - alone_um**2 == pytest.approx(0.5 * (0.3 * 3.0**2) ** 2)
    text = " ".join(str(assumed).split())
    assert "Sheet 1 states both together, as ± 2 u, so that its numbers are larger." in text


def test_a_campaign_takes_its_instrument_from_it(tmp_path: Path) -> None:
    """In campaign.toml as by options; `check` names the certificates, and so does the campaign
    written again."""
    tables = "".join(
        f'[{name}]\ndcc = "{SCHEIN.name}"\n'
        for name in ("bar", "force", "balls.work", "balls.tool")
    )
    folder = tmp_path / "a"
    folder.mkdir()
    plain = tmp_path / "b"
    plain.mkdir()
    shutil.copy(SCHEIN, write(folder, TOML.replace("[[test]]", f"{tables}[[test]]", 1)))
    stated = lb.read_campaign(folder).instrument
    ball = lb.Ball(
        sphericity_um=0.15, certificate=f"{NAME}Rundheitsabweichung / Roundness: Ebene 2"
    )
    bar = f"{NAME}Längenabweichung vom Nennmaß: Messwert"
    force = f"{NAME}Prüfkraft: Kraft, Prüfkraft: Linearitätsabweichung"
    expected = lb.Instrument(
        ball, ball, -0.8, 0.6, None, 0.5, 0.6, bar_certificate=bar, force_certificate=force
    )
    assert stated == expected
    assert (
        lb.read_campaign(lb.write_campaign(lb.read_campaign(folder), tmp_path / "c")).instrument
        == expected
    )
    options = []
    for kind in ("bar", "force", "work-ball", "tool-ball"):
        options += [f"--{kind}-dcc", str(SCHEIN)]
    instrument = instrument_shown(str(folder))
    assert instrument_shown(str(write(plain)), *options) == instrument
    label = f"Certificate of the bar: {NAME}Längenabweichung vom Nennmaß: Messwert"
    assert label in " ".join(instrument.split())
    assert (
        lb.read_campaign(folder, certificates={"bar_U_um": 2.0}).instrument.bar_certificate is None
    )
    simulated = CliRunner().invoke(
        app, ["simulate", str(plain), "--out", str(tmp_path / "d"), *options]
    )
    assert (simulated.exit_code, lb.read_campaign(tmp_path / "d").instrument) == (0, expected)
    refused = CliRunner().invoke(app, ["check", str(plain), *options, "--bar-U-um", "2"])
    assert refused.exit_code == 2
    with pytest.raises(
        lb.InputError, match=r"\[bar\] must have U_um or take it from its dcc, got both"
    ):
        lb.read_campaign(
            write(
                folder,
                TOML.replace("[[test]]", f"[bar]\nU_um = 1.0\ndcc = '{SCHEIN.name}'\n[[test]]", 1),
            )
        )
    with pytest.raises(lb.InputError, match=r"\[bar\]: dcc must lie inside"):
        lb.read_campaign(
            write(folder, TOML.replace("[[test]]", f"[bar]\ndcc = '{SCHEIN}'\n[[test]]", 1))
        )


def test_a_dcc_that_is_no_file_name_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    lb.write_campaign(lb.read_campaign(lb.embedded_campaign()), folder)
    toml = folder / "campaign.toml"
    text = toml.read_text("utf-8")
    toml.write_text(text.replace("[[test]]", "[bar]\ndcc = 5\n\n[[test]]", 1), "utf-8")
    refuses(r"dcc of \[bar\] must be the name of .* file, got 5", lb.read_campaign, folder)


BOMB = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><a>&c;</a>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"%PDF-1.7", "must be XML, got: unclosed token"),
        (b"<html/>", "got the root element 'html'"),
        (BOMB.encode(), "must have no document type"),
        (BOMB.encode("utf-16"), "must have no document type"),
        (b"<a>" * 100_000, "nested at most 100 deep"),
        (b'<?xml version="1.0" encoding="shift_jis"?><a/>', "must be XML"),
    ],
)
def test_what_is_no_certificate_is_refused(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_bytes(content)
    refuses(f"a.xml: .*{message}", lb.campaign.read_dcc, tmp_path / "a.xml")


@pytest.mark.parametrize(("old", "new", "kind", "message"), CASES["not_said"])
def test_what_a_certificate_lacks_is_named(
    old: str, new: str, kind: str, message: str, tmp_path: Path
) -> None:
    path = changed(tmp_path, (old, new))

    def fields_of_instrument() -> object:
        return lb.campaign.read_dcc(path).fields(kind)

    refuses(f"schein.xml: .*{message}", fields_of_instrument)


def test_a_certificate_and_an_option_for_one_ball_are_refused() -> None:
    """A DCC of one ball contradicts an option that states both balls."""
    with pytest.raises(lb.InputError, match="got --balls too"):
        instrument_fields(balls=lb.Ball(grade="G20"), work_dcc=SCHEIN)
