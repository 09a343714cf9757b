() => [...document.querySelectorAll('.sheet')]
  .filter(sheet => sheet.scrollHeight > sheet.clientHeight + 1).map(sheet => [sheet.scrollHeight, sheet.clientHeight])
