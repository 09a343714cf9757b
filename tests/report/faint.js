() => {
  const parse = text => {
    const p = text.match(/[\d.]+/g).map(Number);
    return p.length > 3 && p[3] === 0 ? null : p.slice(0, 3);
  };
  const light = rgb => rgb.map(v => v / 255).map(v => v <= .03928 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [.2126, .7152, .0722][k], 0);
  const found = [];
  for (const element of document.querySelectorAll('h1, h2, h3, p, li, summary, figcaption, caption, th, td, dt, dd, a')) {
    if (!element.getBoundingClientRect().width || !element.textContent.trim()) continue;
    let behind = element;
    while (behind && !parse(getComputedStyle(behind).backgroundColor)) behind = behind.parentElement;
    const ground = behind ? parse(getComputedStyle(behind).backgroundColor) : [255, 255, 255];
    const pair = [parse(getComputedStyle(element).color), ground];
    const [low, high] = pair.map(light).sort((a, b) => a - b);
    if ((high + .05) / (low + .05) < 4.5) found.push([element.tagName, element.textContent.slice(0, 40), pair]);
  }
  return found;
}
