"""``ldbb-bayes check``: look at a campaign before fitting it."""

from __future__ import annotations

from ldbb_bayes.cli.options import (
    CampaignArgument,
    ForceOffsetOption,
    ForceSlopeOption,
    JsonOption,
    MountOption,
    PlaneOption,
    RadiusOption,
    RawOption,
    ResolutionOption,
    TopologyOption,
    campaign_from,
    guarded,
)

__all__ = ["check"]


@guarded
def check(
    campaign: CampaignArgument,
    topology: TopologyOption = None,
    plane: PlaneOption = None,
    radius_mm: RadiusOption = None,
    resolution_um: ResolutionOption = None,
    raw: RawOption = False,
    mount_um_per_bar: MountOption = None,
    force_slope: ForceSlopeOption = None,
    force_offset: ForceOffsetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Preview a campaign: per test what is there and what looks odd, and what a fit will assume. Fits nothing."""
    from ldbb_bayes.analysis.preview import preview
    from ldbb_bayes.cli.show import print_json, reading_console
    from ldbb_bayes.report.text import preview_lines, preview_table

    readings = campaign_from(
        campaign,
        topology=topology,
        plane=plane,
        radius_mm=radius_mm,
        resolution_um=resolution_um,
        raw=raw,
        mount_um_per_bar=mount_um_per_bar,
        force_slope=force_slope,
        force_offset=force_offset,
    )
    seen = preview(readings)
    if as_json:
        print_json(seen.as_dict())
        return
    console = reading_console()
    console.print(preview_table(seen))
    for line in preview_lines(seen):
        console.print(line, markup=False)
