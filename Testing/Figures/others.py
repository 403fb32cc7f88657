"""One atrium on our maps and on the others in use."""

from __future__ import annotations

from atria import Atrium
from cases import DATA
from pictures import Drawn

from LAFlatteningLib.peers.figure import make_peers_figure
from LAFlatteningLib.peers.sum_map import SumTemplate
from LAFlatteningLib.peers.table import compare_peers


def draw(atrium: Atrium) -> Drawn:
    """The page of `la-flatten peers`; SUM on real atria only, since its template is not ours to show."""
    folder = DATA / "sum_atlas"
    template = None
    if atrium.key and folder.is_dir():
        template = SumTemplate.load(folder / "template_3d.vtp", folder / "template_disk.vtp")
    table = compare_peers(atrium.surface, atrium.seeds, template)
    words = "; ".join(
        f"{row.name}: {row.folded_triangles} folded triangles, beta {row.beta_mean:.2f}, {row.spots_lost} of "
        f"{row.spots} spots lost"
        for row in table.rows
    )
    return Drawn(
        "peers",
        make_peers_figure(table),
        f"One atrium ({atrium.title}) on our two maps and on the others in use. Veins and appendage are at the same "
        f"places in every atrium on {', '.join(row.name for row in table.rows if row.standardised)}. {words}.",
    )
