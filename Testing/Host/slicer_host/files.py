"""Loading and saving: ``slicer.app.coreIOManager()`` on the real storage nodes and logics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import slicer

_SCENE = "SceneFile"
# File type -> endings of the names it reads; the longest ending that fits decides.
_ENDINGS = {
    _SCENE: (".mrml", ".mrb"),
    "MarkupsFile": (".mrk.json", ".fcsv"),
    "ModelFile": (".vtk", ".vtp", ".stl", ".ply", ".obj"),
    "VolumeFile": (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd"),
    "SegmentationFile": (".seg.nrrd",),
    "TableFile": (".tsv", ".csv"),
    "ColorTableFile": (".ctbl",),
    "TransformFile": (".h5", ".tfm"),
    "TextFile": (".txt",),
}


class IOManager:
    """``slicer.app.coreIOManager()``."""

    __slots__ = ()

    def fileType(self, name: str) -> str:
        """The type of the file called ``name``; empty if none of the types known here reads it."""
        lower = Path(name).name.lower()
        fitting = [(len(end), kind) for kind, ends in _ENDINGS.items() for end in ends if lower.endswith(end)]
        return max(fitting)[1] if fitting else ""

    def loadNodes(self, file_type: str, properties: dict, loaded=None, messages=None) -> bool:
        """Load a file into the scene; adds its node to the collection ``loaded`` and returns whether it worked."""
        name = str(properties["fileName"])
        if not Path(name).is_file():
            return False
        if file_type == _SCENE:
            return self._load_scene(name, bool(properties.get("clear")), messages)
        reader = _READERS.get(file_type)
        node = reader(name, properties, messages) if reader else None
        if node is None:
            return False
        if loaded is not None:
            loaded.AddItem(node)
        return True

    def fileWriterFileType(self, node) -> str:
        """The type of file that ``node`` is saved as."""
        return "NodeFile"

    def saveNodes(self, file_type: str, properties: dict, messages=None) -> bool:
        """Save the scene or the node ``properties['nodeID']``; returns whether it worked."""
        name = str(properties["fileName"])
        if file_type == _SCENE:
            return self._save_scene(name, messages)
        node = slicer.mrmlScene.GetNodeByID(properties["nodeID"])
        if node.GetStorageNode() is None and not node.AddDefaultStorageNode(name):
            return False
        storage = node.GetStorageNode()
        storage.SetFileName(name)
        if "useCompression" in properties:
            storage.SetUseCompression(int(properties["useCompression"]))
        return bool(storage.WriteData(node))

    @staticmethod
    def _load_scene(name: str, clear: bool, messages) -> bool:
        scene = slicer.mrmlScene
        if name.lower().endswith(".mrb"):
            return bool(scene.ReadFromMRB(name, clear, messages))
        scene.SetURL(name)
        return bool(scene.Connect(messages) if clear else scene.Import(messages))

    @staticmethod
    def _save_scene(name: str, messages) -> bool:
        scene = slicer.mrmlScene
        if name.lower().endswith(".mrb"):
            return bool(scene.WriteToMRB(name, None, messages))
        if name.lower().endswith(".mrml"):
            scene.SetURL(name)
            scene.SetRootDirectory(str(Path(name).parent))
            return bool(scene.Commit())
        return bool(scene.SaveSceneToSlicerDataBundleDirectory(name, None, messages))


def _title(name: str, properties: dict) -> str:
    return properties.get("name") or Path(name).name.split(".")[0]


def _model(name: str, properties: dict, messages):
    axes = properties.get("coordinateSystem", slicer.vtkMRMLStorageNode.CoordinateSystemLPS)
    return slicer.modules.models.logic().AddModel(name, axes, messages)


def _markups(name: str, properties: dict, messages):
    ids = slicer.modules.markups.logic().LoadMarkups(name, properties.get("name") or None, messages)
    return slicer.mrmlScene.GetNodeByID(ids.split(",")[0]) if ids else None


def _volume(name: str, properties: dict, _messages):
    options = 1 if properties.get("labelmap") else 0
    return slicer.modules.volumes.logic().AddArchetypeVolume(name, _title(name, properties), options)


def _table(name: str, properties: dict, _messages):
    return slicer.modules.tables.logic().AddTable(name, properties.get("name", ""))


def _color_table(name: str, properties: dict, _messages):
    return slicer.modules.colors.logic().LoadColorFile(name, properties.get("name"))


def _transform(name: str, _properties: dict, _messages):
    return slicer.modules.transforms.logic().AddTransform(name, slicer.mrmlScene)


def _segmentation(name: str, properties: dict, _messages):
    return slicer.modules.segmentations.logic().LoadSegmentationFromFile(name, True, _title(name, properties))


def _text(name: str, properties: dict, _messages):
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTextNode", _title(name, properties))
    node.AddDefaultStorageNode(name)
    return node if node.GetStorageNode().ReadData(node) else None


_READERS: dict[str, Callable] = {
    "ModelFile": _model,
    "MarkupsFile": _markups,
    "VolumeFile": _volume,
    "TableFile": _table,
    "ColorTableFile": _color_table,
    "TransformFile": _transform,
    "SegmentationFile": _segmentation,
    "TextFile": _text,
}
