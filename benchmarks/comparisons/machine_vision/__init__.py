"""The servo laws of machinevision-toolbox-python beside ours."""
