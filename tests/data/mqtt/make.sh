#!/bin/sh
# Makes the certificates of the tests anew: two authorities, the broker's and a client's certificate
# of the first, a client's of the other. The keys are no secrets: they protect nothing.
set -eu
cd "$(dirname "$0")"
authority() {
    openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 36500 \
        -subj "/CN=$1" -keyout "$1.key" -out "$1.pem" \
        -addext keyUsage=critical,keyCertSign
}
signed() { # signed NAME AUTHORITY
    openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "/CN=$1" \
        -addext subjectAltName=IP:127.0.0.1 -keyout "$1.key" -out "$1.csr"
    openssl x509 -req -in "$1.csr" -CA "$2.pem" -CAkey "$2.key" -days 36500 \
        -copy_extensions copy -out "$1.pem"
    rm "$1.csr"
}
authority authority
authority stranger
signed broker authority
signed vehicle authority
signed intruder stranger
rm authority.key stranger.key
