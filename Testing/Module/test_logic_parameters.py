"""The parameter node: what it holds when it is made, and what it takes."""

import slicer
from logic_case import LogicCase


class TestParameters(LogicCase):
    def test_it_can_be_made_with_nothing_chosen(self):
        p = self.parameters()
        chosen = (p.surface, p.seeds, p.map, p.metrics, p.prepareInput, p.volume, p.bloodRegion, p.otherMap)
        self.assertEqual(chosen, (None,) * 8)

    def test_a_choice_among_kinds_of_nodes_can_be_made_and_taken_back(self):
        p = self.parameters()
        for name in ("prepareInput", "bloodRegion"):
            for kind in ("vtkMRMLSegmentationNode", "vtkMRMLLabelMapVolumeNode"):
                node = slicer.mrmlScene.AddNewNodeByClass(kind)
                setattr(p, name, node)
                self.assertIs(getattr(p, name), node)
                setattr(p, name, None)
                self.assertIsNone(getattr(p, name))
        with self.assertRaises(TypeError):
            p.bloodRegion = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode")
