"""usvnet: how far away is that boat, from one camera, and how sure are we?"""

__version__ = "0.1.0"
