#!/bin/sh
# Run a command where there is a CAN bus named vcan0, with nothing else on it:
#
#   scripts/vcan.sh sh                   a shell, or any command: folder, environment, output, exit status are its own
#   scripts/vcan.sh                      the tests that need such a bus
#   scripts/vcan.sh --where              print where it would be ("namespace" or "machine"), or what is missing
#   scripts/vcan.sh --fetch              fetch a kernel for the machine with apt, once
#
# Where this kernel has vcan, the bus lies in a network namespace of its own. Elsewhere a small virtual machine
# (QEMU, no KVM needed) boots a distribution's kernel over this host's own files: what the command writes is gone
# afterwards, except in the folder $VCAN_KEEP. It has $VCAN_PROCESSORS processors at most, two unless that says so.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cache=${CHIPLOG_VCAN_CACHE:-${XDG_CACHE_HOME:-${HOME:-/tmp}/.cache}/chiplog/vcan}
modules="virtio_pci 9pnet_virtio 9p overlay can-raw can-bcm vcan"
bus="ip link add dev vcan0 type vcan && ip link set up vcan0 && ip link set up lo"

# Root needs no user namespace of its own, and in a chroot may not have one.
separate="unshare --net"
[ "$(id -u)" = 0 ] || separate="unshare --user --map-root-user --net"

has() { PATH="$PATH:/usr/sbin:/sbin" command -v "$1" >/dev/null; }

has_namespace() {
    [ "${CHIPLOG_VCAN_WHERE:-namespace}" = namespace ] && has unshare && has ip &&
        $separate sh -c "$bus" 2>/dev/null
}

# What the machine lacks, one per line: what it is, and the Debian package that has it.
missing() {
    [ "$(uname -s) $(uname -m)" = "Linux x86_64" ] || echo "an x86-64 Linux"
    for pair in qemu-system-x86_64:qemu-system-x86 busybox:busybox-static cpio:cpio candump:can-utils; do
        has "${pair%%:*}" || echo "${pair##*:}"
    done
    [ -e "$cache/vmlinuz" ] || echo "a kernel (scripts/vcan.sh --fetch)"
}

# Take the kernel out of its package, and of its modules those that the machine loads, in their order.
fetch() {
    [ ! -e "$cache/vmlinuz" ] || return 0
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    cd "$work"
    for meta in linux-image-amd64 linux-image-generic; do # Debian's and Ubuntu's; a "cloud" kernel has no CAN
        image=$(apt-cache depends "$meta" 2>/dev/null | sed -n 's/.*Depends: \(linux-image-[0-9].*\)/\1/p' | head -n 1)
        [ -z "$image" ] || break
    done
    [ -n "$image" ] || { echo "vcan.sh: apt knows no kernel package: run  apt-get update  first" >&2; exit 2; }
    version=${image#linux-image-}
    apt-get download -qq -o APT::Sandbox::User=root "$image"
    apt-get download -qq -o APT::Sandbox::User=root \
        "linux-modules-$version" "linux-modules-extra-$version" 2>/dev/null || true # Ubuntu's
    for package in *.deb; do dpkg -x "$package" tree; done
    [ -e tree/lib/modules ] || ln -s usr/lib tree/lib
    PATH="$PATH:/usr/sbin:/sbin"
    depmod -b "$work/tree" "$version"
    mkdir -p "$cache/modules"
    for module in $modules; do
        modprobe -d "$work/tree" -S "$version" --show-depends "$module"
    done | awk '$1 == "insmod" && !seen[$2]++ { print $2 }' | while read -r path; do
        plain=$(basename "$path")
        case $plain in
        *.ko) cp "$path" "$cache/modules/" ;;
        *.xz) plain=${plain%.xz} && xz -dc "$path" >"$cache/modules/$plain" ;;
        *.zst) plain=${plain%.zst} && zstd -qdc "$path" >"$cache/modules/$plain" ;;
        *.gz) plain=${plain%.gz} && gzip -dc "$path" >"$cache/modules/$plain" ;;
        esac
        echo "$plain"
    done >"$cache/modules/order"
    grep -q '^vcan.ko$' "$cache/modules/order" || { echo "vcan.sh: $image has no vcan" >&2; exit 2; }
    cp "tree/boot/vmlinuz-$version" "$cache/vmlinuz.new"
    mv "$cache/vmlinuz.new" "$cache/vmlinuz" # last: with it, all is there
}

quoted() { for word; do printf "'%s' " "$(printf %s "$word" | sed "s/'/'\\\\''/g")"; done; }

in_machine() {
    lacking=$(missing | paste -sd, | sed 's/,/, /g')
    [ -z "$lacking" ] || { echo "vcan.sh: no vcan in this kernel, and for a virtual machine missing: $lacking" >&2; exit 2; }
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    mkdir -p "$work/files/bin" "$work/share"
    cp "$(command -v busybox)" "$work/files/bin/busybox"
    cp -r "$cache/modules" "$work/files/"
    install -m 755 "$here/vcan_init.sh" "$work/files/init"
    (cd "$work/files" && find . | cpio -o -H newc --quiet | gzip -1 >"$work/initramfs.gz")
    {
        export -p
        echo "cd $(quoted "$PWD")"
        echo "exec $(quoted "$@")"
    } >"$work/share/command"
    set -- -fsdev "local,id=share,path=$work/share,security_model=none" -device virtio-9p-pci,fsdev=share,mount_tag=share
    if [ -n "${VCAN_KEEP:-}" ]; then
        printf %s "$VCAN_KEEP" >"$work/share/keep"
        set -- "$@" -fsdev "local,id=keep,path=$VCAN_KEEP,security_model=none" -device virtio-9p-pci,fsdev=keep,mount_tag=keep
    fi
    # As many processors as here, two at most: a plant and a firmware. What runs alone takes less than half of this
    # host's time on one (33 core-s for 75).
    processors=$(getconf _NPROCESSORS_ONLN)
    most=${VCAN_PROCESSORS:-2}
    [ "$processors" -lt "$most" ] || processors=$most
    qemu-system-x86_64 -accel tcg,thread=multi -cpu max -smp "$processors" -m 1536 \
        -nodefaults -no-user-config -no-reboot -display none -serial stdio -device virtio-rng-pci \
        -kernel "$cache/vmlinuz" -initrd "$work/initramfs.gz" \
        -append "console=ttyS0 quiet loglevel=1 panic=-1 mitigations=off" \
        -fsdev local,id=root,path=/,security_model=none,readonly=on,multidevs=remap \
        -device virtio-9p-pci,fsdev=root,mount_tag=root "$@"
    [ -e "$work/share/status" ] || { echo "vcan.sh: the virtual machine ended before its command did" >&2; exit 2; }
    return "$(cat "$work/share/status")"
}

case ${1:-} in
--fetch) fetch; exit ;;
--where)
    if has_namespace; then echo namespace; exit; fi
    lacking=$(missing | paste -sd, | sed 's/,/, /g')
    [ -z "$lacking" ] && echo machine && exit
    echo "no vcan in this kernel, and for a virtual machine missing: $lacking"
    exit 1
    ;;
"") cd "$here/.." && exec .venv/bin/python -m pytest -n 0 -m vcan tests ;;
esac

export CHIPLOG_VCAN=vcan0
if has_namespace; then
    exec $separate sh -c "$bus"' && exec "$@"' sh "$@"
fi
in_machine "$@"
