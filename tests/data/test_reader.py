import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests_data import boat_frame  # noqa: F401

