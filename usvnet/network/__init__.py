"""The pose network: image in, boxes, coarse keypoints and heatmaps out. Torch only, no geometry."""
