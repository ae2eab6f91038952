"""The bridge between usvnet and ROS 2: messages in, messages out, and a thin node between them."""
