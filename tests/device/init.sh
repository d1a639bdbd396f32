#!/bin/busybox sh
# First process of the guest: its root is a folder of the host, read-only, with all writing kept in memory.
/bin/busybox --install -s /bin
export PATH=/bin
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
while read -r module; do
  insmod /modules/$module || echo "insmod $module failed"
done </modules.list
options=trans=virtio,version=9p2000.L,msize=512000
mount -t 9p -o $options,ro,cache=loose host /host || poweroff -f
mount -t tmpfs -o size=75% memory /memory; mkdir /memory/upper /memory/work
mount -t overlay -o "lowerdir=/host$(cat /root.path),upperdir=/memory/upper,workdir=/memory/work" root /root || poweroff -f
mkdir -p /root/host /root/shared /root/proc /root/sys /root/dev /root/tmp
mount -o bind /host /root/host
mount -t 9p -o $options,cache=none shared /root/shared
mount --move /proc /root/proc; mount --move /sys /root/sys; mount --move /dev /root/dev
mkdir -p /root/dev/shm; mount -t tmpfs shm /root/dev/shm
ip link set lo up
echo "booted in $(cut -d' ' -f1 /root/proc/uptime) s"
chroot /root /bin/sh /shared/job; echo $? >/root/shared/code
poweroff -f
