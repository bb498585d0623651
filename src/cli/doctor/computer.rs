//! Properties of this computer on which frames and controllers depend: access rights, network, buffers, disk.

use nix::unistd::{AccessFlags, Gid, Group, Uid, User, access as may};
use std::fmt::Write;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// The receive buffer that carved asks for by default, bytes.
const SOCKET_BUFFER: u64 = 4 << 20;
/// Size of a plate of 96 larvae at 21 views of 1 MB, with masks and meshes, bytes.
const A_PLATE: u64 = 4 << 30;

/// One line about who may open a port, if this user may not. Else empty.
pub fn access(port: &str) -> String {
    let Ok(facts) = std::fs::metadata(port) else { return String::new() };
    if may(port, AccessFlags::R_OK | AccessFlags::W_OK).is_ok() {
        return String::new();
    }
    let owner = User::from_uid(Uid::from_raw(facts.uid())).ok().flatten().map_or_else(|| facts.uid().to_string(), |user| user.name);
    let group = Group::from_gid(Gid::from_raw(facts.gid())).ok().flatten().map_or_else(|| facts.gid().to_string(), |group| group.name);
    format!(
        "you may not open it: it is {owner}:{group}, mode {:o}. `sudo usermod -aG {group} $USER`, then log in again; the service has the group\n",
        facts.mode() & 0o777
    )
}

/// The network interface that leads to an address.
pub struct Way {
    pub interface: String,
    pub mtu: u32,
}

pub fn way_to(address: Ipv4Addr) -> Option<Way> {
    // Connecting a datagram socket sends nothing, but the kernel selects a route.
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).ok()?;
    socket.connect((address, 9)).ok()?;
    let IpAddr::V4(here) = socket.local_addr().ok()?.ip() else { return None };
    let has_it = |interface: &nix::ifaddrs::InterfaceAddress| {
        interface.address.as_ref().and_then(|a| a.as_sockaddr_in()).is_some_and(|a| {
            // All of 127.0.0.0/8 belongs to the loopback interface.
            a.ip() == here || (a.ip().is_loopback() && here.is_loopback())
        })
    };
    let interface = nix::ifaddrs::getifaddrs().ok()?.find(has_it)?.interface_name;
    let mtu = number(&format!("/sys/class/net/{interface}/mtu"))?;
    Some(Way { interface, mtu: u32::try_from(mtu).ok()? })
}

/// What runs need of this computer, and what to do if it is missing.
pub fn facts(data: &Path) -> String {
    let mut text = String::new();
    let _ = match number("/proc/sys/net/core/rmem_max") {
        Some(limit) if limit >= SOCKET_BUFFER => writeln!(text, "net.core.rmem_max = {limit}: enough for a camera's bursts"),
        Some(limit) => writeln!(
            text,
            "net.core.rmem_max = {limit}: frames will be lost; {SOCKET_BUFFER} at least. `sudo install -m 0644 systemd/90-carved.conf \
             /etc/sysctl.d/ && sudo sysctl --system`"
        ),
        None => writeln!(text, "net.core.rmem_max cannot be read: the camera's receive buffer may be too small"),
    };
    // A folder that does not exist yet will be on the disk of its nearest existing parent.
    let there = data.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
    let _ = match nix::sys::statvfs::statvfs(there) {
        Ok(disk) => {
            let free = disk.blocks_available() * disk.fragment_size();
            let verdict = if free < A_PLATE { ": less than a plate of 96 larvae takes (4 GB); make room" } else { "" };
            writeln!(text, "{} GB free for runs in {}{verdict}", free >> 30, data.display())
        }
        Err(error) => writeln!(text, "{}: {error}", data.display()),
    };
    text
}

fn number(file: &str) -> Option<u64> {
    std::fs::read_to_string(file).ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_to_this_computer_is_its_loopback() {
        let way = way_to(Ipv4Addr::new(127, 0, 0, 9)).unwrap();
        assert_eq!((way.interface.as_str(), u64::from(way.mtu)), ("lo", number("/sys/class/net/lo/mtu").unwrap()));
    }

    #[test]
    fn a_folder_that_is_not_there_is_on_the_disk_of_the_one_above_it() {
        let folder = tempfile::tempdir().unwrap();
        let said = facts(&folder.path().join("not/yet"));
        assert!(said.contains("GB free for runs") && said.contains("net.core.rmem_max"), "{said}");
    }
}
