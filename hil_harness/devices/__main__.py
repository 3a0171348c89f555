"""``python -m hil_harness.devices`` prints the folder of ``chiplog_device.h``, for ``gcc -I``."""

from hil_harness.devices.shared_library import include_dir

print(include_dir())
