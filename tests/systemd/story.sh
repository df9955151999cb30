#!/bin/sh
# Run by the systemd of a clean root, once: installs, upgrades, rolls back and purges two packages.
# Arguments: the older package, the newer one. Each step adds `NAME: ANSWER` to /story.txt.
old=$1 new=$2 config=/etc/moar-companion/companion.yaml
export DEBIAN_FRONTEND=noninteractive

tell() {  # tell NAME COMMAND…: its last line, and its status unless that is 0
    name=$1
    shift
    "$@" >/answer 2>&1
    status=$?
    [ "$status" -eq 0 ] || echo "status $status" >>/answer
    echo "$name: $(tail -n 1 /answer)" >>/story.txt
    cat /answer >>/story.log
}

version() {
    dpkg-query --showformat='${Version} ${Status}\n' --show moar-companion
}

rule_faults() {  # what udev reports when it reads the rules
    udevadm test /sys/class/tty/tty 2>&1 | grep 61-moar-companion.rules: || true
}

as_member() {  # as a user who is in the group, and no more
    setpriv --reuid=pilot --regid=pilot --groups=moar-companion "$@"
}

armed_aircraft() {  # a view that shows an armed aircraft; then the upgrade
    systemctl stop moar-companion
    install -d /run/moar-companion
    /usr/lib/moar-companion/bin/python -I - <<'END' &
import socket
server = socket.socket(socket.AF_UNIX)
server.bind("/run/moar-companion/view.sock")
server.listen()
sections = '"mission": {}, "risk": {}, "weights": {}, "age_s": {}'
while True:
    reader, _ = server.accept()
    reader.sendall(b'{"aircraft": {"armed": true}, %b}\n' % sections.encode())
END
    server=$!
    while [ ! -S /run/moar-companion/view.sock ]; do sleep 0.1; done
    dpkg --install "$new"
    status=$?
    kill "$server"
    rm -r /run/moar-companion
    systemctl start moar-companion
    return "$status"
}

useradd pilot
tell install apt-get install --yes "$old"
tell version version
tell enabled systemctl is-enabled moar-companion
tell active systemctl is-active moar-companion
tell user stat --format %U "/proc/$(systemctl show --value -p MainPID moar-companion)"
tell unprivileged grep CapEff "/proc/$(systemctl show --value -p MainPID moar-companion)/status"
tell rules rule_faults
tell member as_member moar-companion view --once
tell check setpriv --reuid=moar-companion --regid=moar-companion --clear-groups moar-companion check --files
tell cached ls /var/cache/moar-companion
tell log journalctl --no-pager --quiet -u moar-companion
tell log-fields journalctl --no-pager --quiet -u moar-companion -n 1 -o json --output-fields=LOGGER,PRIORITY LOGGER=moar_companion.service.app

sed -i 's/^setpoint_rate_hz: 50.0/setpoint_rate_hz: 40.0/' "$config"
tell in-flight armed_aircraft
tell kept-version version
tell kept-active systemctl is-active moar-companion
tell upgrade apt-get install --yes -o Dpkg::Options::=--force-confold "$new"
tell upgraded-version version
tell upgraded-active systemctl is-active moar-companion
tell upgraded-config grep setpoint_rate_hz: "$config"

install -d /etc/moar-companion/second
sed 's/14540/14541/; s,: vehicles/,: ../vehicles/,; s,: sites/,: ../sites/,' "$config" \
    >/etc/moar-companion/second/companion.yaml
tell second systemctl start moar-companion@second
tell second-active systemctl is-active moar-companion@second
tell second-view moar-companion view --once /run/moar-companion/second/view.sock
tell second-state ls -d /var/lib/moar-companion/second
tell second-stop systemctl stop moar-companion@second
rm -r /etc/moar-companion/second

tell rollback apt-get install --yes --allow-downgrades -o Dpkg::Options::=--force-confold "$old"
tell rolled-back-version version
tell rolled-back-active systemctl is-active moar-companion
tell rolled-back-config grep setpoint_rate_hz: "$config"

for folder in flights recordings; do  # recorder.directory may be any folder here
    install -D /dev/null "/var/lib/moar-companion/$folder/flight_1/flight.mcap"
done
touch /var/lib/moar-companion/mission.json
tell remove apt-get remove --yes moar-companion
tell removed-active systemctl is-active moar-companion
tell removed-config grep setpoint_rate_hz: "$config"
tell removed-program find /usr/lib/moar-companion -newer /story.sh
tell purge apt-get purge --yes moar-companion
tell purged find / -xdev -name '*moar-companion*' -not -path '/var/log/*' -not -path '/var/lib/moar-companion'
tell kept-flights sh -c 'cd /var/lib/moar-companion && find . -type f | sort | xargs'
systemctl exit 0
