"""The simulator: a Holzapfel-Ogden left ventricle inflated to its end-diastolic pressure."""
