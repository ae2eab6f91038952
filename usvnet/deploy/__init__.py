"""Taking a trained model away: to C++, to another Python, to a robot."""
