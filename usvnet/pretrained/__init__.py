"""Networks that another program trained: their files read without running them, their weights put into ours."""
