#!/bin/busybox sh
# The first process of the machine of vcan.sh: this host's files, read-only, below a layer in memory; vcan0; then the
# command. What goes wrong is said on the console, which is the host's terminal.
bb=/bin/busybox
$bb mkdir -p /proc /sys /dev /host /layer /new
$bb mount -t proc proc /proc
$bb mount -t sysfs sysfs /sys
$bb mount -t devtmpfs devtmpfs /dev
while read -r module; do $bb insmod "/modules/$module"; done </modules/order

shared=trans=virtio,version=9p2000.L,msize=512000
$bb mount -t 9p -o "$shared,ro,cache=loose" root /host
$bb mount -t tmpfs tmpfs /layer
$bb mkdir /layer/upper /layer/work
$bb mount -t overlay -o lowerdir=/host,upperdir=/layer/upper,workdir=/layer/work overlay /new
for folder in proc sys dev; do $bb mount -o move "/$folder" "/new/$folder"; done
for folder in /run /dev/shm; do
    $bb mkdir -p "/new$folder"
    $bb mount -t tmpfs tmpfs "/new$folder"
done
$bb mkdir -p /new/dev/pts /new/run/share
$bb mount -t devpts -o ptmxmode=666 devpts /new/dev/pts
$bb mount -t 9p -o "$shared" share /new/run/share
if [ -e /new/run/share/keep ]; then
    keep="/new$($bb cat /new/run/share/keep)"
    $bb mkdir -p "$keep"
    $bb mount -t 9p -o "$shared" keep "$keep"
fi

$bb ip link set up lo
$bb ip link add dev vcan0 type vcan
$bb ip link set up vcan0
$bb chroot /new /bin/sh /run/share/command
echo $? >/new/run/share/status
$bb sync
$bb poweroff -f
