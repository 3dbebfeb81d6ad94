#pragma once

namespace lanewise {

/// Share of messages that arrive over a distance without interference: Nakagami fading with m = 3 over power
/// that falls with the square of the distance (Killat, Hartenstein: An empirical model for probability of
/// packet reception in vehicular ad hoc networks, EURASIP J. Wireless Communications and Networking 2009,
/// 721301, Eq. 3). @param ratio2 (distance / fading range)^2, the fading range being where the mean power is
/// what the receiver needs.
double FadingReception(double ratio2);

/// Share of the stations a receiver hears that its sender, `distance` [m] away, does not hear: two circles of
/// the carrier-sense range, evenly filled. They may start to send while the sender does.
double HiddenShare(double distance, double carrier_sense_range);

/// Share of messages no hidden station sends into, of Poisson senders (Abramson 1970): one is lost if another
/// starts within an airtime before or after its own start. @param load busy share of the channel at the
/// receiver.
double CollisionFree(double load, double hidden_share);

/// Time [s] a frame of `bytes` is on the air: IEEE 802.11-2012, 18.4.3, 10 MHz: 32 us preamble, 8 us signal
/// field, then symbols of 8 us for 16 service bits, the frame and 6 tail bits. @param bitrate [bit/s]
double Airtime(double bytes, double bitrate);

}  // namespace lanewise
