"""Predict once, score often: records, metrics, reports and pictures of what usvnet says about a dataset.

The metrics (:mod:`.records`, :mod:`.pose_metrics`, :mod:`.range_metrics`) know nothing of models or datasets, so that
training can score its validation batches with them; :mod:`.evaluator` ties everything for ``evaluate.py``.
"""
