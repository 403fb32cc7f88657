"""Stands in for Slicer's module SampleData, so far as samples are made by a function and not downloaded.

As in Slicer, the samples are in ``slicer.modules.sampleDataSources``, a dict of category to list, and a sample's own
function is called by its button, not by the logic.
"""

from __future__ import annotations

from collections.abc import Callable

import slicer


class SampleDataSource:
    """One sample: its name and the function that makes it."""

    __slots__ = ("customDownloader", "fileNames", "nodeNames", "sampleName", "thumbnailFileName")

    def __init__(
        self, sampleName: str, customDownloader: Callable, thumbnailFileName=None, nodeNames=None, fileNames=None
    ):
        self.sampleName, self.customDownloader = sampleName, customDownloader
        self.thumbnailFileName, self.nodeNames, self.fileNames = thumbnailFileName, nodeNames, fileNames


class SampleDataLogic:
    """The logic of SampleData."""

    @staticmethod
    def registerCustomSampleDataSource(category="Custom", sampleName=None, uris=None, fileNames=None, nodeNames=None,
                                       customDownloader=None, thumbnailFileName=None, loadFileType="VolumeFile",
                                       loadFiles=None, loadFileProperties=None, checksums=None) -> None:  # fmt: skip
        """Add a sample to a category. Only samples with a ``customDownloader`` are known here."""
        if not sampleName or customDownloader is None or uris or loadFiles or loadFileProperties or checksums:
            raise ValueError(
                f"The host knows only samples made by a customDownloader, not {sampleName!r} from {uris!r}"
            )
        # Slicer counts the files of a sample, one for each address, and fails where one of these is missing.
        if not isinstance(uris, str) or fileNames is None:
            raise TypeError(f"Expected uris and fileNames as text, found {uris!r} and {fileNames!r}")
        source = SampleDataSource(sampleName, customDownloader, thumbnailFileName, nodeNames, fileNames)
        others = SampleDataLogic.sampleDataSourcesByCategory().setdefault(category, [])
        if sampleName not in [other.sampleName for other in others]:
            others.append(source)

    @staticmethod
    def sampleDataSourcesByCategory(category: str | None = None):
        """The samples of a category; without one, the dict of all."""
        if not hasattr(slicer.modules, "sampleDataSources"):
            slicer.modules.sampleDataSources = {}
        sources = slicer.modules.sampleDataSources
        return sources if category is None else sources.get(category, [])

    def sourceForSampleName(self, sampleName: str) -> SampleDataSource | None:
        """The sample of that name, or None."""
        every = self.sampleDataSourcesByCategory().values()
        return next((source for sources in every for source in sources if source.sampleName == sampleName), None)


def logic() -> SampleDataLogic:
    """The logic of the module."""
    return SampleDataLogic()
